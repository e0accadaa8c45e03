// SPDX-License-Identifier: Apache-2.0
// Exponential shadow map (Annen, Mertens, Seidel, Flerackers, Kautz 2008): s = e^{-c d} [w * e^{c z}] clamped to [0,1].
// Written about the far plane: E = e^{c (z - 1)} and s = E e^{c (1 - d)}. For z, d in [0,1] and c <= 80 every factor
// stays inside float (E in [1.8e-35, 1], the other at most 1.8e38), so nothing overflows however the map is filtered.
// z, d: linear depth, 0 at the light's near plane, 1 at its far plane. Each function is finite for every input.
#ifndef GOBO_FORMULAS_EXPONENTIAL_SHADOW_MAP
#define GOBO_FORMULAS_EXPONENTIAL_SHADOW_MAP
#include "formulas/shadow_map.glsl.h"
FORMULAS_BEGIN

/// E of one texel, 1 <= c <= 80. A depth that is not finite counts as "nothing hit" (z = 1), so that no filter can spread it.
FORMULA float esmEncode(float z, float c) {
  PRECISE float x = (c * 1.44269504088896341f) * (shadowDepth(z) - 1.0f);
  return exp2InRange(x);  // x in [-115.5, 0]
}

/// Unnormalised Gaussian at `offset` texels.
FORMULA float esmGaussian(float offset, float sigma) { return fastExp(-0.5f * (offset * offset) / (sigma * sigma)); }

/// e^{c (1 - d)}: what E is multiplied by for a receiver at depth d (its bias subtracted).
FORMULA float esmReceiver(float d, float c) {
  PRECISE float x = (c * 1.44269504088896341f) * (1.0f - shadowReceiver(d));
  return exp2InRange(minOf(x, 127.0f));
}

/// Visibility of a receiver; points that the map does not cover are lit.
FORMULA float esmVisibility(float e, float receiver, bool covered) { return CHOOSE(covered, limit(finiteOr(e * receiver, 1.0f), 0.0f, 1.0f), 1.0f); }

FORMULAS_END
#endif

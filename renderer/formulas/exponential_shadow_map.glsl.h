// SPDX-License-Identifier: Apache-2.0
// Exponential shadow map (Annen, Mertens, Seidel, Flerackers, Kautz 2008): s = e^{-c d} [w * e^{c z}] clamped to [0,1].
// Written about the far plane: E = e^{c (z - 1)} and s = E e^{c (1 - d + bias)}. For z, d in [0,1] and c <= 80 every factor
// stays inside float (E in [1.8e-35, 1], the other at most 1.8e38), so nothing overflows however the map is filtered.
// z, d: linear depth, 0 at the light's near plane, 1 at its far plane. Each function is finite for every input.
#ifndef GOBO_FORMULAS_EXPONENTIAL_SHADOW_MAP
#define GOBO_FORMULAS_EXPONENTIAL_SHADOW_MAP
#include "formulas/math.glsl.h"
FORMULAS_BEGIN

/// E of one texel, 1 <= c <= 80. A depth that is not finite counts as "nothing hit" (z = 1), so that no filter can spread it.
FORMULA float esmEncode(float z, float c) {
  PRECISE float x = (c * 1.44269504088896341f) * (limit(finiteOr(z, 1.0f), 0.0f, 1.0f) - 1.0f);
  return exp2InRange(x);   // x in [-115.5, 0]
}

/// Unnormalised Gaussian at `offset` texels.
FORMULA float esmGaussian(float offset, float sigma) { return fastExp(-0.5f * (offset * offset) / (sigma * sigma)); }

/// One row of the light's affine map: a . (p) + b, p relative to the frame's origin.
FORMULA float esmRow(float ax, float ay, float az, float b, float px, float py, float pz) {
  PRECISE float s = ((ax * px + ay * py) + az * pz) + b;
  return s;
}

/// 1 / w where the point lies in front of the light (w > 0), else 0.
FORMULA float esmInverse(float w) { return CHOOSE(finiteOr(w, -1.0f) > 1.0e-20f, 1.0f / maxOf(w, 1.0e-20f), 0.0f); }

/// Is the map coordinate covered? A NaN is not.
FORMULA bool esmCovered(float u, float v, float inverseW) {
  return (u >= 0.0f) && (u <= 1.0f) && (v >= 0.0f) && (v <= 1.0f) && (inverseW > 0.0f);
}

/// Texel position of coordinate u on an axis of `size` texels, limited to the centres of the first and the last one.
FORMULA float esmTexel(float u, float size) {
  PRECISE float t = limit(finiteOr(u, 0.0f), 0.0f, 1.0f) * size - 0.5f;
  return limit(t, 0.0f, size - 1.0f);
}

/// Bilinear mean of four texels.
FORMULA float esmBilinear(float e00, float e10, float e01, float e11, float fx, float fy) {
  PRECISE float top = e00 * (1.0f - fx) + e10 * fx;
  PRECISE float bottom = e01 * (1.0f - fx) + e11 * fx;
  PRECISE float e = top * (1.0f - fy) + bottom * fy;
  return e;
}

/// e^{c (1 - d + bias)} for bias >= 0: what E is multiplied by for a receiver at depth d.
FORMULA float esmReceiver(float d, float c, float bias) {
  PRECISE float x = (c * 1.44269504088896341f) * ((1.0f - limit(finiteOr(d, 0.0f), 0.0f, 1.0f)) + bias);
  return exp2InRange(minOf(x, 127.0f));   // bias up to 1: 160 log2(e) would leave float
}

/// Visibility of a receiver; points that the map does not cover are lit.
FORMULA float esmVisibility(float e, float receiver, bool covered) {
  return CHOOSE(covered, limit(finiteOr(e * receiver, 1.0f), 0.0f, 1.0f), 1.0f);
}

FORMULAS_END
#endif

// SPDX-License-Identifier: Apache-2.0
// Variance shadow maps (Donnelly & Lauritzen 2006). The moments are those of z - 1/2: squares of at most 1/4 lose a quarter of
// the bits that z^2 would to cancellation.
#ifndef GOBO_FORMULAS_VARIANCE_SHADOW_MAP
#define GOBO_FORMULAS_VARIANCE_SHADOW_MAP
#include "formulas/shadow_map.glsl.h"
FORMULAS_BEGIN

FORMULA float vsmFirst(float z) { return shadowDepth(z) - 0.5f; }
FORMULA float vsmSecond(float z) {
  float m = shadowDepth(z) - 0.5f;
  return m * m;
}

/// One-sided Chebyshev bound on the share of the kernel at or behind t, for first and second moment (m1, m2) of the same variable as t.
FORMULA float vsmChebyshev(float m1, float m2, float t, float minVariance) {
  PRECISE float v = m2 - m1 * m1;
  float variance = maxOf(finiteOr(v, 0.0f), minVariance);
  float gap = t - m1;
  float bound = variance / maxOf(variance + gap * gap, 1.0e-37f);
  return CHOOSE(gap <= 0.0f, 1.0f, limit(finiteOr(bound, 1.0f), 0.0f, 1.0f));
}

/// Visibility of a receiver at depth d.
FORMULA float vsmVisibility(float m1, float m2, float d, float minVariance) { return vsmChebyshev(m1, m2, shadowReceiver(d) - 0.5f, minVariance); }

FORMULAS_END
#endif

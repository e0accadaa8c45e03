// SPDX-License-Identifier: Apache-2.0
// Exponential variance shadow maps (Lauritzen & McCool 2008): Chebyshev on e^{c+ z} and on -e^{-c- z}; the smaller bound holds.
// Written about the ends of the range: p = e^{c+ (z - 1)} in (0,1], q = -e^{-c- z} in [-1,0), so that for c <= 42 every square
// is a normal float (e^{-84} = 3.3e-37) however the map is filtered.
#ifndef GOBO_FORMULAS_EXPONENTIAL_VARIANCE_SHADOW_MAP
#define GOBO_FORMULAS_EXPONENTIAL_VARIANCE_SHADOW_MAP
#include "formulas/variance_shadow_map.glsl.h"
FORMULAS_BEGIN

FORMULA float evsmPositive(float z, float c) { return fastExp(c * (z - 1.0f)); }
FORMULA float evsmNegative(float z, float c) { return -fastExp(-c * z); }

/// Visibility from the filtered moments of both warps, each in units of the receiver's own warp: there squares of small warps and their
/// variances stay normal floats. minVariance is in squared depth ranges: a warp w of slope c w has c^2 times it in those units.
FORMULA float evsmVisibility(float p1, float p2, float q1, float q2, float d, float cPositive, float cNegative, float minVariance) {
  float r = shadowReceiver(d);
  float p = fastExp(cPositive * (1.0f - r)), q = fastExp(cNegative * r);  // at most e^42, squares e^84
  float front = vsmChebyshev(p1 * p, p2 * (p * p), 1.0f, minVariance * (cPositive * cPositive));
  float back = vsmChebyshev(q1 * q, q2 * (q * q), -1.0f, minVariance * (cNegative * cNegative));
  return minOf(front, back);
}

FORMULAS_END
#endif

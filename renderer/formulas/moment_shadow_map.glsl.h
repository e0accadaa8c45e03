// SPDX-License-Identifier: Apache-2.0
// Moment shadow maps, four moments (Peters & Klein 2015, "Hamburger"): the sharpest lower bound on the share of the kernel in front
// of a depth that the first four moments allow. Depth is mapped to t = 2 z - 1 in [-1,1], where the moments are best conditioned.
#ifndef GOBO_FORMULAS_MOMENT_SHADOW_MAP
#define GOBO_FORMULAS_MOMENT_SHADOW_MAP
#include "formulas/shadow_map.glsl.h"
FORMULAS_BEGIN

FORMULA float msmCoordinate(float z) { return 2.0f * z - 1.0f; }

/// Upper bound of visibility at depth d for moments b1..b4 of t. `bias` mixes in the moments (0, 1/3, 0, 1/5) of the uniform
/// distribution, whose Hankel matrix is positive definite: rounding then cannot make the mixture indefinite.
FORMULA float msmVisibility(float m1, float m2, float m3, float m4, float d, float bias) {
  float keep = 1.0f - bias;
  float b1 = keep * m1, b2 = keep * m2 + bias * 0.333333333f, b3 = keep * m3, b4 = keep * m4 + bias * 0.2f;
  float t = msmCoordinate(shadowReceiver(d));
  // Cholesky of [[1, b1, b2], [b1, b2, b3], [b2, b3, b4]] and the solution q of B q = (1, t, t^2).
  PRECISE float l32 = b3 - b1 * b2;
  PRECISE float d22 = maxOf(b2 - b1 * b1, 1.0e-12f);
  PRECISE float f33 = b4 - b2 * b2;
  PRECISE float d33 = maxOf(f33 - l32 * l32 / d22, 1.0e-14f);
  float n32 = l32 / d22;
  PRECISE float y2 = t - b1;
  PRECISE float y3 = (t * t - b2) - n32 * y2;
  float q3 = y3 / d33;
  PRECISE float q2 = y2 / d22 - n32 * q3;
  PRECISE float q1 = 1.0f - b1 * q2 - b2 * q3;
  // Roots r1 <= r2 of q3 r^2 + q2 r + q1; q3 near zero: one root at infinity.
  float lead = CHOOSE(q3 < 0.0f, minOf(q3, -1.0e-20f), maxOf(q3, 1.0e-20f));
  float p = q2 / lead, q = q1 / lead;
  PRECISE float disc = p * p * 0.25f - q;
  float root = sqrtOf(maxOf(finiteOr(disc, 0.0f), 0.0f));
  float r1 = -p * 0.5f - root, r2 = -p * 0.5f + root;
  // Share of the distribution in front of t (Peters & Klein 2015, algorithm 3).
  PRECISE float before = (t * r2 - b1 * (t + r2) + b2) / nonzero((r2 - r1) * (t - r1));
  PRECISE float behind = 1.0f - (r1 * r2 - b1 * (r1 + r2) + b2) / nonzero((t - r1) * (t - r2));
  float shadow = CHOOSE(t <= r1, 0.0f, CHOOSE(t <= r2, before, behind));
  return limit(1.0f - finiteOr(shadow, 0.0f), 0.0f, 1.0f);
}

FORMULAS_END
#endif

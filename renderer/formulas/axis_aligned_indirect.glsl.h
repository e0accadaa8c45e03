// SPDX-License-Identifier: Apache-2.0
// Axis-aligned filtering of indirect light: band limits, filter widths, sampling rate (Mehta, Wang, Ramamoorthi, Durand 2013; Wang,
// UCB/EECS-2013-118, equations 4.3 to 4.6), and the width of least predicted error that takes their place here.
// Common subset of C++ and GLSL: pure functions of floats, no branches.
//   z       distance from the receiver to what its light comes from, metres
//   omega   band limit of the lobe, rad per unit slope: 2.8 for a diffuse surface, 3.6 + 0.084 m for a Blinn-Phong lobe of exponent m
//   d       world width of a pixel at the receiver, metres
//   mu      convergence parameter: larger narrows the filter
#ifndef GOBO_FORMULAS_AXIS_ALIGNED_INDIRECT
#define GOBO_FORMULAS_AXIS_ALIGNED_INDIRECT

#include "formulas/math.glsl.h"
FORMULAS_BEGIN

FORMULA float aaDiffuseBand() { return 2.8f; }
FORMULA float aaSpecularBand(float exponent) { return 3.6f + 0.084f * exponent; }

/// Blinn-Phong exponent of a GGX lobe, m = 2 / alpha^2 - 2, at most 2e6.
FORMULA float aaPhongExponent(float alpha) { return maxOf(2.0f / maxOf(alpha * alpha, 1.0e-6f) - 2.0f, 0.0f); }

/// Filter width, metres: z_min / (2 mu omega). (Equation 4.4 prints 2 z_min / omega; the authors' code has this as the standard deviation.)
FORMULA float aaIndirectWidth(float zMin, float omega, float mu) { return zMin / (2.0f * mu * omega); }

/// Paths of a pixel, equation 4.6: 0.4 (0.9 omega d / z_min + 0.3)^2 omega^2 (1 + 0.9 z_max / z_min)^2. Unbounded where surfaces meet.
FORMULA float aaIndirectSamples(float zMin, float zMax, float omega, float d) {
  float a = 0.9f * omega * d / zMin + 0.3f;
  float b = 1.0f + 0.9f * zMax / zMin;
  return 0.4f * a * a * omega * omega * b * b;
}

/// Standard deviation, in pixels, of least squared bias (kappa w^2 c)^2 plus noise V / (4 pi w^2): w^6 = V / (8 pi kappa^2 c^2). variance V of a pixel;
/// curvature c: light over the square of its distance in pixels. 0 without noise, at most 1e4 pixels.
#define AA_KAPPA 0.2f
FORMULA float aaIndirectPredictedWidth(float variance, float curvature) {
  float bend = AA_KAPPA * curvature;
  // By halves of the exponent: neither square leaves float's range.
  float ratio = sqrtOf(maxOf(variance, 0.0f) * 0.039788736f) / maxOf(bend, 1.0e-30f);
  return CHOOSE(ratio > 0.0f, minOf(fastExp(fastLog(limit(ratio, 1.0e-30f, 1.0e30f)) / 3.0f), 1.0e4f), 0.0f);
}

/// Curvature of what a lobe of GGX width alpha shows, from that of its light, the light and the turning of the reflected direction by the way of one pixel
/// (radians: of the view, and twice that of the normal).
FORMULA float aaSpecularCurvature(float curvature, float light, float turning, float alpha) {
  float lobe = 3.2f * (alpha + 0.02f);
  float rate = (sqrtOf(maxOf(curvature, 0.0f)) + sqrtOf(maxOf(light, 0.0f)) * turning) / lobe;
  return minOf(rate * rate, 1.0e30f);
}

FORMULAS_END
#endif

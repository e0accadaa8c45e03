// SPDX-License-Identifier: Apache-2.0
// Axis-aligned filtering of indirect light: the width of least predicted error, in the place of the band limit Omega / z of the nearest surface (Mehta,
// Wang, Ramamoorthi, Durand 2013; Wang, UCB/EECS-2013-118, equations 4.3 and 4.4). trace/curvature_sums.h says what curvature is.
// Common subset of C++ and GLSL: pure functions of floats, no branches.
#ifndef GOBO_FORMULAS_AXIS_ALIGNED_INDIRECT
#define GOBO_FORMULAS_AXIS_ALIGNED_INDIRECT

#include "formulas/math.glsl.h"
FORMULAS_BEGIN

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

/// The source's band limit of a lobe, radians of angle per radian: of Lambert surfaces, and of GGX width alpha by the Blinn-Phong exponent m = 2 / alpha^2 - 2.
#define AA_OMEGA_DIFFUSE 2.8f
FORMULA float aaOmegaSpecular(float alpha) {
  float a = limit(alpha, 0.01f, 1.0f);
  return 3.6f + 0.084f * (2.0f / (a * a) - 2.0f);
}

/// Equation 4.4, metres, of the nearest surface at zNear and a pixel d wide: as printed, and as the authors' programs have it, whose 2 zNear / Omega is no
/// standard deviation but the radius of the loop.
FORMULA float aaIndirectWidthPrinted(float zNear, float omega, float d) { return maxOf(2.0f * zNear / omega, d / 0.15f); }
FORMULA float aaIndirectWidthReleased(float zNear, float omega, float d, float mu) { return maxOf(zNear / (2.0f * mu * omega), 0.5f * d); }

/// Equation 4.6: samples of a pixel d wide between a nearest and a farthest surface. Unbounded at contacts.
FORMULA float aaIndirectSamples(float omega, float d, float zNear, float zFar) {
  float a = 0.9f * omega * d / zNear + 0.3f;
  float b = 1.0f + 0.9f * zFar / zNear;
  return 0.4f * a * a * omega * omega * b * b;
}

FORMULAS_END
#endif

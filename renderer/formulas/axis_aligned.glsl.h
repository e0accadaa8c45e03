// SPDX-License-Identifier: Apache-2.0
// Axis-aligned filtering of area-light shadows: band limit, filter width, sampling rate (Mehta, Wang, Ramamoorthi 2012; Wang,
// UCB/EECS-2013-118, equations 3.4 and 3.5, with the misprints of 3.4 corrected and the released code's cap of 3.5 beside it).
// Common subset of C++ and GLSL: pure functions of floats, no branches.
//   slope   s = d1/d2 - 1 of an occluder at distance d2 from the light, d1 = receiver to light; equal to t/(T-t) for a hit at t
//           on a shadow ray of length T, whatever way both are measured
//   sMin    smallest slope seen (occluder nearest to the receiver), sMax the largest (occluder nearest to the light)
//   sigma   standard deviation of the light's profile, metres;  d  world width of a pixel at the receiver, metres
//   mu      convergence parameter: the band limit of the light scaled by mu (1 = the report)
//   omega   band limit in image space, rad/m;  beta = 1/(k omega)  standard deviation of the filter, metres
#ifndef GOBO_FORMULAS_AXIS_ALIGNED
#define GOBO_FORMULAS_AXIS_ALIGNED

#include "formulas/math.glsl.h"
FORMULAS_BEGIN

/// Slopes stay in this range: a contact (t -> 0) would ask for endless rays, an occluder on the light (t = T) for an endless filter.
#define AA_SLOPE_MIN 1.0e-4f
#define AA_SLOPE_MAX 1.0e3f

/// s = t/(T-t), clamped; finite for every 0 <= t <= T, T > 0.
FORMULA float aaSlope(float t, float T) { return minOf(maxOf(t / maxOf(T - t, T * 1.0e-6f), AA_SLOPE_MIN), AA_SLOPE_MAX); }

/// Band limit, rad/m: what the light lets through (mu / (sigma sMin)) or what pixels can hold of the occluder (1 / (d (1 + sMin))).
FORMULA float aaBandLimit(float sMin, float sigma, float d, float mu) { return minOf(mu / (sigma * sMin), 1.0f / (d * (1.0f + sMin))); }

/// Filter width, metres (equation 3.4 corrected: (1/k) max(sigma s / mu, d d1/d2max)).
FORMULA float aaBeta(float omega, float k) { return 1.0f / (k * omega); }

/// Shadow rays for a pixel, equation 3.5 as printed (generalised by mu): 4 (1 + mu sMax/sMin)^2 (2 mu/sMin sqrt(Ap/Al) + 1/(1+sMin))^2
/// with sqrt(Ap/Al) = d/(2 sigma). Unbounded at contacts.
FORMULA float aaSamplesPrinted(float sMin, float sMax, float sigma, float d, float mu) {
  float a = 1.0f + mu * sMax / sMin;
  float b = mu * d / (sigma * sMin) + 1.0f / (1.0f + sMin);
  return 4.0f * a * a * b * b;
}

/// The same with both frequencies capped by what a pixel can hold; never above the printed one.
FORMULA float aaSamplesCapped(float sMin, float sMax, float sigma, float d, float mu) {
  float w = aaBandLimit(sMin, sigma, d, mu);
  float a = 1.0f / (1.0f + sMin) + d * w;
  float b = 1.0f + sigma * minOf(sMax * w, sMax / (d * (1.0f + sMax)));
  return 4.0f * a * a * b * b;
}

/// Lights at infinity, the limit d1 -> infinity of the above with sigma s -> sigma z: slopes are distances z of the occluder from the receiver along the
/// light's axis, metres, sigma is in metres a metre, and the magnification 1 + s is 1. Distances stay in this range of metres, so that products with any
/// sigma and mu are normal numbers.
#define AA_DISTANCE_MIN 1.0e-18f
#define AA_DISTANCE_MAX 1.0e18f
FORMULA float aaDistance(float z) { return minOf(maxOf(z, AA_DISTANCE_MIN), AA_DISTANCE_MAX); }

/// aaBandLimit of a light at infinity: widths are (1/k) max(sigma zMin / mu, d).
FORMULA float aaDistantBandLimit(float zMin, float sigma, float d, float mu) { return minOf(mu / (sigma * zMin), 1.0f / d); }

/// aaSamplesCapped of a light at infinity.
FORMULA float aaDistantSamples(float zMin, float zMax, float sigma, float d, float mu) {
  float w = aaDistantBandLimit(zMin, sigma, d, mu);
  float a = 1.0f + d * w;
  float b = 1.0f + sigma * zMax * w;
  return 4.0f * a * a * b * b;
}

/// aaSamplesPrinted of a light at infinity.
FORMULA float aaDistantSamplesPrinted(float zMin, float zMax, float sigma, float d, float mu) {
  float a = 1.0f + mu * zMax / zMin;
  float b = mu * d / (sigma * zMin) + 1.0f;
  return 4.0f * a * a * b * b;
}

/// Variance of the visibility that n Owen-scrambled Sobol points give a receiver in a penumbra: 0.2 / n^2 (fitted to 4 to 64 points on the scenes
/// "grids" and "two-trees"; widths follow its tenth to fifth root).
FORMULA float aaNoise(float n) { return 0.2f / (n * n); }

/// Filters of order 2 (a Gaussian) and 4 (the same without second moment). Squared bias, averaged over a penumbra of 6 standard deviations, of an
/// edge seen by a uniform square or disk, is about AA_BIAS r^AA_BIAS_POWER, where r is the filter's width in the penumbra's standard
/// deviations (r in 0.35..1; the corners that such lights leave in a penumbra keep the power below the order's 4 and 8). AA_GAIN: the sum of
/// squared weights over that of the Gaussian, 27/16 along each axis.
#define AA_BIAS_2 0.0029f
#define AA_BIAS_POWER_2 3.3f
#define AA_BIAS_4 0.00022f
#define AA_BIAS_POWER_4 3.4f
#define AA_GAIN_4 2.84766f

/// The width of least predicted error: of bias B (w/S)^p squared plus noise aaNoise(n) gain / (4 pi w^2), at its minimum in w. penumbra S: standard
/// deviation of the narrowest penumbra around, in pixels; the result too, never above S.
FORMULA float aaPredictedWidth(float penumbra, float n, bool fourthOrder) {
  float bias = CHOOSE(fourthOrder, AA_BIAS_4, AA_BIAS_2);
  float power = CHOOSE(fourthOrder, AA_BIAS_POWER_4, AA_BIAS_POWER_2);
  float gain = CHOOSE(fourthOrder, AA_GAIN_4, 1.0f);
  float ratio = aaNoise(n) * gain / (6.2831853f * power * bias * penumbra * penumbra);
  return penumbra * minOf(fastExp(fastLog(ratio) / (power + 2.0f)), 1.0f);
}

/// Weight of a sample at squared light-plane distance dist2 (equation 3.3 unnormalised); inverse = 1/(2 beta^2).
FORMULA float aaWeight(float dist2, float inverse) { return fastExp(-dist2 * inverse); }

FORMULAS_END
#endif

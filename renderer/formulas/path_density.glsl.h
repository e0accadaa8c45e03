// SPDX-License-Identifier: Apache-2.0
// Distances of path samples, and what of them is kept by how far their neighbours are (docs/path_density.md). Common subset of C++ and GLSL.
#ifndef GOBO_FORMULAS_PATH_DENSITY
#define GOBO_FORMULAS_PATH_DENSITY

#include "formulas/formulas.h"
FORMULAS_BEGIN

/// Distance on the film (in sigmas of the metric) plus that of colours (CIELAB likewise): a sum of two norms, not the norm of all five differences.
FORMULA float productDistance(float dx, float dy, float dl, float da, float db) { return sqrtOf(dx * dx + dy * dy) + sqrtOf(dl * dl + da * da + db * db); }

/// Weight of a sample whose mean distance to its neighbours is sigma: 1 up to `soft`, 0 from `hard` on, a cubic between (first derivatives are 0 at both).
/// soft = hard is a step, at which 1 counts.
FORMULA float densityRamp(float sigma, float soft, float hard) {
  float t = (hard - sigma) / CHOOSE(hard > soft, hard - soft, 1.0f);
  return CHOOSE(sigma <= soft, 1.0f, CHOOSE(sigma >= hard, 0.0f, t * t * (3.0f - 2.0f * t)));
}

/// Of t >= 0.008: an estimate from the exponent, then two of Halley's steps (each cubes the relative error of 0.05).
FORMULA float labCubeRoot(float t) {
  float y = floatOf(bitsOf(t) / 3 + 709921077);
  float c = y * y * y;
  y = y * ((c + 2.0f * t) / (2.0f * c + t));
  c = y * y * y;
  return y * ((c + 2.0f * t) / (2.0f * c + t));
}

/// CIELAB's curve of a tristimulus value over the white point's, odd in it: a cube root above (6/29)^3, straight below.
FORMULA float labCurve(float t) {
  float m = absOf(t);
  float curved = labCubeRoot(CHOOSE(m < 216.0f / 24389.0f, 216.0f / 24389.0f, m)) - 4.0f / 29.0f;
  float straight = m * (841.0f / 108.0f);
  float v = CHOOSE(m > 216.0f / 24389.0f, curved, straight);
  return CHOOSE(t < 0.0f, -v, v) + 4.0f / 29.0f;
}

FORMULAS_END
#endif

// SPDX-License-Identifier: Apache-2.0
// Display transform of a linear picture, per channel: exposure, then a curve to [0,1] (still linear light; the sRGB
// transfer belongs to the encoder). Each curve is monotone, maps 0 to 0, and reads NaN and negative values as 0.
//   LINEAR     x, cut at 1
//   REINHARD   x / (1 + x)                                    (Reinhard et al. 2002, eq. 3; never reaches 1)
//   FILMIC     x (2.51 x + 0.03) / (x (2.43 x + 0.59) + 0.14)  (K. Narkowicz's 2015 fit to the ACES reference tone curve;
//              toe and shoulder, reaches 1 near x = 7.2; the 0.6 pre-scale of the ACES default is left to exposure)
#ifndef GOBO_FORMULAS_TONE_MAP
#define GOBO_FORMULAS_TONE_MAP
#include "formulas/math.glsl.h"
FORMULAS_BEGIN

/// Factor of `stops`: 2^stops, exact for whole stops.
FORMULA float exposureScale(float stops) { return fastExp2(stops); }

/// Limits radiance to what the curves divide safely; NaN and negative values become 0, +infinity the largest.
FORMULA float toneMapInput(float x) { return CHOOSE(x > 0.0f, minOf(x, 1.0e9f), 0.0f); }

FORMULA float toneMapLinear(float x) { return minOf(toneMapInput(x), 1.0f); }

FORMULA float toneMapReinhard(float x) {
  float y = toneMapInput(x);
  return y / (1.0f + y);
}

FORMULA float toneMapFilmic(float x) {
  float y = toneMapInput(x);
  return minOf((y * (2.51f * y + 0.03f)) / (y * (2.43f * y + 0.59f) + 0.14f), 1.0f);
}

FORMULAS_END
#endif

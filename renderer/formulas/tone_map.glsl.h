// SPDX-License-Identifier: Apache-2.0
// Display transform of a linear picture: exposure, then a curve to [0,1] (still linear light; the transfer function belongs to
// the encoder, base/transfer.h). Each curve maps 0 to 0, is monotone on greys, and reads NaN and negative values as 0.
// Per channel:
//   LINEAR     x, cut at 1
//   REINHARD   x / (1 + x)                                    (Reinhard et al. 2002, eq. 3; never reaches 1)
//   FILMIC     x (2.51 x + 0.03) / (x (2.43 x + 0.59) + 0.14)  (K. Narkowicz's 2015 fit to the ACES reference tone curve;
//              toe and shoulder, reaches 1 near x = 7.2; the 0.6 pre-scale of the ACES default is left to exposure)
// Of a colour (the channel's value first, then the colour it belongs to, where one formula serves all three):
//   ACES       S. Hill's fit of RRT + ODT (BakingLab, ACES.hlsl): Rec.709 to RRT's space, (x (x + 0.0245786) - 0.000090537) /
//              (x (0.983729 x + 0.4329510) + 0.238081), and back; greys stay grey, reaches 1 near x = 25.7. Bright colours go to white.
//   NEUTRAL    Khronos PBR Neutral (2024): base colours below 0.8 - 0.04 keep their hue and value less the 4 % of Fresnel,
//              highlights are compressed and desaturated; never reaches 1.
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

FORMULA float acesCurve(float x) { return (x * (x + 0.0245786f) - 0.000090537f) / (x * (0.983729f * x + 0.4329510f) + 0.238081f); }

/// One row of the output matrix (o0 o1 o2) over the curve of the three input rows; r, g, b as toneMapInput gives them.
FORMULA float acesRow(float r, float g, float b, float o0, float o1, float o2) {
  float x = acesCurve(0.59719f * r + 0.35458f * g + 0.04823f * b);
  float y = acesCurve(0.07600f * r + 0.90834f * g + 0.01566f * b);
  float z = acesCurve(0.02840f * r + 0.13383f * g + 0.83777f * b);
  return limit(o0 * x + o1 * y + o2 * z, 0.0f, 1.0f);
}
FORMULA float toneMapAcesRed(float r, float g, float b) { return acesRow(toneMapInput(r), toneMapInput(g), toneMapInput(b), 1.60475f, -0.53108f, -0.07367f); }
FORMULA float toneMapAcesGreen(float r, float g, float b) { return acesRow(toneMapInput(r), toneMapInput(g), toneMapInput(b), -0.10208f, 1.10813f, -0.00605f); }
FORMULA float toneMapAcesBlue(float r, float g, float b) { return acesRow(toneMapInput(r), toneMapInput(g), toneMapInput(b), -0.00327f, -0.07276f, 1.07602f); }

/// Channel `c` (one of r, g, b) of the colour.
FORMULA float toneMapNeutral(float c, float r, float g, float b) {
  float x = toneMapInput(c);
  float low = minOf(toneMapInput(r), minOf(toneMapInput(g), toneMapInput(b)));
  float high = maxOf(toneMapInput(r), maxOf(toneMapInput(g), toneMapInput(b)));
  float offset = CHOOSE(low < 0.08f, low - 6.25f * low * low, 0.04f);
  float peak = high - offset;
  float compressed = 1.0f - 0.0576f / (maxOf(peak, 0.76f) + (0.24f - 0.76f));  // 0.0576 = 0.24^2, 0.24 = 1 - 0.76
  float grey = 1.0f - 1.0f / (0.15f * (maxOf(peak, 0.76f) - compressed) + 1.0f);
  float scaled = (x - offset) * (compressed / maxOf(peak, 0.76f));
  return limit(CHOOSE(peak < 0.76f, x - offset, scaled + (compressed - scaled) * grey), 0.0f, 1.0f);
}

FORMULAS_END
#endif

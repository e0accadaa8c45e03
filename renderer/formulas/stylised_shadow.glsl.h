// SPDX-License-Identifier: Apache-2.0
// Transfer of stylised shadows (DeCoro, Cole, Finkelstein, Rusinkiewicz 2007, equation 3 of the thesis' chapter 3 with the factor 1 - b): signed distance to
// the shadow's contour, negative in shadow, to the share of light that is left.
#ifndef GOBO_FORMULAS_STYLISED_SHADOW
#define GOBO_FORMULAS_STYLISED_SHADOW
#include "formulas/math.glsl.h"
FORMULAS_BEGIN

/// 3 t^2 - 2 t^3 of t limited to 0..1: C^1. Exactly 0 and 1 at the ends.
FORMULA float smoothStep01(float t) {
  float u = limit(t, 0.0f, 1.0f);
  return u * u * (3.0f - 2.0f * u);
}

/// 6 t^5 - 15 t^4 + 10 t^3 of t limited to 0..1: C^2. Exactly 0 and 1 at the ends.
FORMULA float quinticStep01(float t) {
  float u = limit(t, 0.0f, 1.0f);
  float v = 1.0f - u;  // each half by its own end: near 1 the sum of the other cancels
  float low = u * u * u * (u * (u * 6.0f - 15.0f) + 10.0f), high = v * v * v * (v * (v * 6.0f - 15.0f) + 10.0f);
  return CHOOSE(u <= 0.5f, low, 1.0f - high);
}

/// 0 below t = 0, 1 from t = 1 on, `bands` values at equal steps between. bands >= 1.
FORMULA float staircase01(float t, float bands) {
  float u = limit(t, 0.0f, 1.0f);
  float between = (minOf(floorOf(u * bands), bands - 1.0f) + 1.0f) / (bands + 1.0f);
  return CHOOSE(t < 0.0f, 0.0f, CHOOSE(t >= 1.0f, 1.0f, between));
}

/// b where d <= i - s/2, 1 where d >= i + s/2, smooth between; a step at i where s = 0, which is dark itself. s >= 0, b in [0, 1]. The result is in [b, 1]: b +
/// (1 - b) rounds to 1 for every b.
FORMULA float styledVisibility(float d, float inflation, float softness, float brightness) {
  float across = smoothStep01((d - inflation) / maxOf(softness, 1.0e-30f) + 0.5f);
  float t = CHOOSE(softness > 0.0f, across, CHOOSE(d > inflation, 1.0f, 0.0f));
  return brightness + (1.0f - brightness) * t;
}

/// The same with another step: kind 0 smooth, 1 quintic, 2 a staircase.
FORMULA float styledVisibilityBy(int kind, float bands, float d, float inflation, float softness, float brightness) {
  float u = (d - inflation) / maxOf(softness, 1.0e-30f) + 0.5f;
  float across = CHOOSE(kind == 0, smoothStep01(u), CHOOSE(kind == 1, quinticStep01(u), staircase01(u, bands)));
  float t = CHOOSE(softness > 0.0f, across, CHOOSE(d > inflation, 1.0f, 0.0f));
  return brightness + (1.0f - brightness) * t;
}

/// Where d lies in the band from i - s/2 to i + s/2: 0 .. 1, outside of it below 0 or above 1; finite for s = 0.
FORMULA float bandPosition(float d, float inflation, float softness) { return (d - inflation) / maxOf(softness, 1.0e-30f) + 0.5f; }

/// The same along a curve of straight lines, at `between` (0 .. 1) of the one from `before` to `after`; u = bandPosition(d, i, s). What lies beside the band is
/// in full shadow or full light, wherever the curve begins and ends.
FORMULA float styledVisibilityAlong(float before, float after, float between, float u, float d, float inflation, float softness, float brightness) {
  float along = before + (after - before) * limit(between, 0.0f, 1.0f);
  float across = CHOOSE(u < 0.0f, 0.0f, CHOOSE(u > 1.0f, 1.0f, along));
  float t = CHOOSE(softness > 0.0f, across, CHOOSE(d > inflation, 1.0f, 0.0f));
  return brightness + (1.0f - brightness) * t;
}

/// Length of the pixel of width 1 about x that lies in lines of width w, `spacing` apart, one about 0: its mean over x is w / spacing. 0 <= w <= spacing,
/// spacing >= 2.
FORMULA float hatching01(float x, float spacing, float w) {
  float u = x - floorOf(x / spacing + 0.5f) * spacing;
  float h = 0.5f * w;
  float at = maxOf(minOf(u + 0.5f, h) - maxOf(u - 0.5f, -h), 0.0f);
  float after = maxOf(minOf(u + 0.5f, spacing + h) - maxOf(u - 0.5f, spacing - h), 0.0f);
  float before = maxOf(minOf(u + 0.5f, h - spacing) - maxOf(u - 0.5f, -h - spacing), 0.0f);
  return limit(at + after + before, 0.0f, 1.0f);
}

FORMULAS_END
#endif

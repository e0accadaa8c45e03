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

/// b where d <= i - s/2, 1 where d >= i + s/2, smooth between; a step at i where s = 0, which is dark itself. s >= 0, b in [0, 1]. The result is in [b, 1]: b +
/// (1 - b) rounds to 1 for every b.
FORMULA float styledVisibility(float d, float inflation, float softness, float brightness) {
  float across = smoothStep01((d - inflation) / maxOf(softness, 1.0e-30f) + 0.5f);
  float t = CHOOSE(softness > 0.0f, across, CHOOSE(d > inflation, 1.0f, 0.0f));
  return brightness + (1.0f - brightness) * t;
}

FORMULAS_END
#endif

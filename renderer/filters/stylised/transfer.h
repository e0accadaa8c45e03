// SPDX-License-Identifier: Apache-2.0
// Transfer of a stylised shadow: the cheap last stage, all that inflation, softness and brightness re-run.
//
// Computes     S(x) = b + (1 - b) smoothstep(i - s/2, i + s/2, D(x)), a step at D = i where s = 0 (formulas/stylised_shadow.glsl.h). In [b, 1], 1 where D =
// 1e30, and never
//              greater for greater i, never less for greater b or D.
// Inputs       0: plane D (filters/stylised/distance_field.h); 1, for coloured visibility: plane V of 3 channels.
// Output       term "visibility", plane V. Of three channels: S V where the light arrives (a channel of V is at least 1/2), and S itself where it did not: what
// is made light in a
//              shadow has no colour of glass.
// Parameters   inflation and softness in the units of D, softness >= 0; brightness 0 .. 1.
// Identity     Hard visibility and i = s = b = 0: S = V to the bit, for D carries the sign of V.
// Cost         8 bytes and 10 operations an element.
#pragma once

#include "terms/node.h"

namespace gobo {

struct StyleTransferSettings {
  float inflation = 0, softness = 0, brightness = 0;
};

NodePtr makeStyleTransferNode(const StyleTransferSettings& settings);

}  // namespace gobo

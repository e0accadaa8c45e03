// SPDX-License-Identifier: Apache-2.0
// Subtractive shadows (DeCoro, Rusinkiewicz 2008; DeCoro's thesis, chapter 4): direct light as C, unshadowed light in full detail, and S, what few lights would
// add and do not. With U and V the sums over the few lights, unshadowed and seen, resampled from where they were traced (receiver.h), times the lobe's albedo
// here:
//   Difference   C - (U - V), no less than 0 (equation 4.1). A control variate of weight 1: better than V alone where more than half of the light is seen.
//   Ratio        C V / U, each channel. Never outside [0, C]; 0 where nothing is seen, C where everything is. Where U is 0 in a channel
//                the lobe's other channels decide, then the other lobe, and without any light above the horizon nothing is in shadow.
//   Beta         V + b (C - U), no less than 0: b by regression of seen over unshadowed light, over the lights, within [0, 1]
//                (Szecsi, Sbert, Szirmay-Kalos 2004)
// Each of the lobes by itself. No occluder: C to the bit, in every form.
// Inputs: G-buffer, surface, subtractive samples of a map (samples.h) or of lights (scene_lights.h), unshadowed light (planes "diffuse", "specular" f32x3, view
// samples). Term "direct_light", domain Pixel: "diffuse", "specular" f32x3, means over view samples; "negative" f32x3, what of both lobes would have been below
// zero and is not shown, as a positive number. A traced sample that no neighbour speaks for (no footprint that is a positive number) has its own sums; what has
// neither is counted in "dropped", beside what the unshadowed light lacks. Error: that of the few lights' shadows alone. Too few of them are hard and banded,
// at r > 1 detail finer than r pixels is lost. Cost: up to (2 reach / r + 1)^2 neighbours of 10 ns a view sample; at r = 1 none.
#pragma once

#include "techniques/subtractive/receiver.h"

namespace gobo::subtractive {

enum class Form : uint8_t { Ratio, Beta, Difference };

struct LightSettings {
  GBufferSettings view;
  Resampling resampling;
  Form form = Form::Ratio;
  int lights = 1;  ///< that the samples are sums over, for the means of Beta
};
NodePtr makeLightNode(const LightSettings& settings);

/// Sums over the few lights at one sample: of one lobe, by its albedo; moments of their luminances.
struct FewLights {
  Vec3 unshadowed{0.0f}, visible{0.0f};
  float squares = 0, seen = 0;
};
/// Light of one lobe, before negative light is cut. `c`: unshadowed light, >= 0; `other`: the other lobe's sums, for channels without light.
Vec3 subtract(Form form, const Vec3& c, const Vec3& albedo, const FewLights& few, const FewLights& other, int lights);

}  // namespace gobo::subtractive

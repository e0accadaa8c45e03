// SPDX-License-Identifier: Apache-2.0
// Light of few directional lights, unshadowed and as it is seen, for the samples of a view that stand for the others: those on the grid (every r-th pixel of
// every r-th row), and those that none on the grid speaks for (another surface, another orientation), which are found here by geometry alone. Of all samples
// that are traced every light is, so at r = 1 this is the lights' direct light.
// Inputs: G-buffer, surface. Term "subtractive_samples", domain ViewSample:
//   "unshadowed", "visible" f32x6   diffuse and specular radiance by what the lobes reflect of light from everywhere (Receivers::divisors), sums over lights
//   "moments" f32x4                 sums of squares of the lights' shares in their luminance, and of those that are seen: diffuse, its seen, specular, its seen
//   "traced" u8                     1 where these are; elsewhere all of it is 0
// The visible sum is no more than the unshadowed one, and the same bits where nothing stands before the lights. Sums in double.
// Cost: a ray and about 0.1 us of material a light and traced sample. Shadows of solid surfaces: clear ones would be solid.
#pragma once

#include <vector>

#include "techniques/subtractive/receiver.h"

namespace gobo::subtractive {

struct DistantLightSample {
  Vec3 direction{0, 1, 0};  ///< towards it, unit, world
  Vec3 irradiance{0.0f};    ///< W/m^2, on a plane that faces it
};

struct SamplesSettings {
  GBufferSettings view;
  Resampling resampling;
  std::vector<DistantLightSample> lights;
};
NodePtr makeSamplesNode(const SamplesSettings& settings);

}  // namespace gobo::subtractive

// SPDX-License-Identifier: Apache-2.0
// Ambient light without shadows: radiance in spherical harmonics of order 2 from infinity, reflected by the diffuse lobe of every surface.
// Inputs: G-buffer, surface. Output: "direct_light", domain Pixel, plane "rgb": mean over view samples of
//   albedo (1 - metallic) (1 - transmission) / pi * max(E(N), 0),  E by Ramamoorthi & Hanrahan 2001 (formulas/harmonics.glsl.h).
// Of materials that the surface term does not hold what their diffuse lobe reflects, below what lies on it (diffuse_albedo.h), instead of the albedo.
// Approximate: no occlusion (it is what other lights leave over: small, and any occlusion term would be a guess), no gloss.
// Zero on unlit surfaces and background. Cost: about 60 operations per view sample.
#pragma once

#include <array>

#include "scene/camera.h"
#include "terms/node.h"

namespace gobo {
inline namespace filters {

struct AmbientLightSettings {
  std::array<Vec3, 9> radiance{};  ///< coefficients in the map's axes, for nominal power
  float rotation = 0;              ///< of the map about +Y, radians (scene/environment.h)
  int width = 0, height = 0, viewSamples = 1;
  bool extended = false;  ///< there are materials that the surface term does not hold, which are read again
  Camera camera{};        ///< then: of the G-buffer
};
NodePtr makeAmbientLightNode(const AmbientLightSettings& settings);

}  // namespace filters
}  // namespace gobo

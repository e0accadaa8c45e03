// SPDX-License-Identifier: Apache-2.0
// Source: how large the errors of candidate shadow techniques are for this light and this view, measured on some pixels before any
// of them is run. Truth: hard shadows over the pixel's area (what more view samples would show), soft ones over the
// light at the pixel's view samples. Rays are judged by their own sequences; maps by *virtual* maps: a ray from the light through each
// texel centre that a lookup would read, so that no map has to be made to know what it would say.
#pragma once

#include <vector>

#include "filters/shadow_map/light_frame.h"
#include "scene/camera.h"
#include "terms/node.h"

namespace gobo::inline filters {

/// One map that could be made.
struct ProbeMap {
  LightFrames frames;
  int resolution = 0;
};

struct ShadowProbeSettings {
  Camera camera;
  int width = 0, height = 0, viewSamples = 1;  ///< of the picture
  int pixels = 300;                            ///< judged: evenly spread, at a random place in their cell each
  std::vector<uint32_t> rays;                  ///< ray counts per view sample to judge, ascending
  uint32_t truthRays = 16;                     ///< per view sample and half of the truth, at most 64; area lights
  uint64_t seed = 0;
  bool clear = false;  ///< what light passes straight on is not there: it is the same for all candidates (trace/solid_scene.h)
};
/// Term "shadow_probe", domain Table, an element per view sample of the judged pixels: planes P, Ng f32x3, instance u32 (a G-buffer for Receivers);
/// a, b f32: two independent halves of the pixel's true visibility (of its first view sample's element; (V - a)(V - b) is free of the truth's own
/// noise in the mean); lit f32: 1 where the light can shine. Planes rays f64: RMSE (a standard error above the estimate) of each ray count (first elements),
/// share f64: share of the pixels that show a receiver (first element). A small output.
NodePtr makeShadowProbeNode(const ShadowProbeSettings& settings);

struct MapProbeSettings {
  ProbeMap map;
  float bias = 0.0005f, slopeBias = 1.0f;
  Vec2 size{0.0f};  ///< soft shadows: SoftLight::size (filters/soft_shadow/soft_shadow.h); 0: hard
  int viewSamples = 1;
  bool clear = false;  ///< as the shadow probe's
};
/// Term "map_probe", plane rmse f64 (the same bound): of the map's visibility over the pixels of input "shadow_probe". Hard: the bilinear comparison; soft:
/// percentage-closer soft shadows with 36 + 64 taps. A small output.
NodePtr makeMapProbeNode(const MapProbeSettings& settings);

}  // namespace gobo::inline filters

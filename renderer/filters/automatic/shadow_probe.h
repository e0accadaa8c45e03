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

namespace gobo {

/// One map that could be made.
struct ProbeMap {
  LightFrames frames;
  int resolution = 0;
};

struct ShadowProbeSettings {
  Camera camera;
  int width = 0, height = 0, viewSamples = 1;   ///< of the picture
  int pixels = 1200;            ///< judged: evenly spread, at a random place in their cell each
  std::vector<ProbeMap> maps;
  float bias = 0.0005f, slopeBias = 1.0f;
  Vec2 size{0.0f};              ///< soft shadows: full width of the light along its map's axes, metres (directional: 2 tan of half its angle); 0: hard
  std::vector<uint32_t> rays;   ///< ray counts per view sample to judge, ascending
  uint32_t truthRays = 32;      ///< per view sample and half of the truth, at most 64; area lights
  uint64_t seed = 0;
};

/// Term "shadow_probe", domain Table, width rays.size() + maps.size(): plane rmse f64, RMSE of visibility over the receivers that the light can
/// shine on: of each ray count, then of each map (hard: the bilinear comparison; soft: percentage-closer
/// soft shadows with 36 + 64 taps). Plane receivers f64: the share of the pixels that show a receiver (first element). A small output.
NodePtr makeShadowProbeNode(const ShadowProbeSettings& settings);

}  // namespace gobo

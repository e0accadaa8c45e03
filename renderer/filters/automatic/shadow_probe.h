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
inline namespace filters {

/// One map that could be made.
struct ProbeMap {
  LightFrames frames;
  int resolution = 0;
};

struct ShadowProbeSettings {
  Camera camera;
  int width = 0, height = 0, viewSamples = 1;  ///< of the picture
  int cells = 576, split = 64, judged = 128;   ///< ProbeDesign (probe_pixels.h); judged: 8 at least
  std::vector<uint32_t> rays;                  ///< ray counts per view sample to judge, ascending
  uint32_t truthRays = 16;                     ///< per view sample and half of the truth, at most 64; area lights
  uint64_t seed = 0;
  bool clear = false;  ///< what light passes straight on is not there: it is the same for all candidates (trace/solid_scene.h)
};
/// Term "shadow_probe", domain Table, an element per view sample of the judged pixels: planes P, Ng f32x3, instance u32 (a G-buffer for Receivers);
/// lit f32: 1 where the light can shine. Of a pixel's first element: a, b f32: two independent halves of the pixel's true visibility ((V - a)(V - b) is free of
/// the truth's own noise in the mean); weight f64, stratum u32: ProbePixel's. Planes mse, variance f64: mean squared error over what the light can shine on of
/// each ray count, and the variance of that estimate (first elements); share f64: share of the pixels that show a receiver (first element).
NodePtr makeShadowProbeNode(const ShadowProbeSettings& settings);
/// Rays that it takes, at most.
double shadowProbeRays(const ShadowProbeSettings& settings);

struct MapProbeSettings {
  ProbeMap map;
  float bias = 0.0005f, slopeBias = 1.0f;
  Vec2 size{0.0f};  ///< soft shadows: SoftLight::size (filters/soft_shadow/soft_shadow.h); 0: hard
  int viewSamples = 1;
  bool clear = false;  ///< as the shadow probe's
};
/// Term "map_probe", planes mse and variance f64 (as the shadow probe's): of the map's visibility over the pixels of input "shadow_probe". Hard: the bilinear
/// comparison; soft: percentage-closer soft shadows with 36 + 64 taps. Plane penumbra f64: share of receivers that are partly lit by the map. A small output.
NodePtr makeMapProbeNode(const MapProbeSettings& settings);

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Source: how large the errors of candidate shadow techniques are for this light and this view, measured on some pixels before any
// of them is run. Truth: hard shadows over the pixel's area (what more view samples would show), soft ones over the
// light at the pixel's view samples. Rays are judged by their own sequences; any other technique by its own nodes, which take the probe's pixels for a
// G-buffer; hard maps by *virtual* ones: a ray from the light through each texel centre that a lookup would read, so that no map has to be made to know
// what it would say.
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
  uint32_t truthRays = 16;                     ///< per view sample, in each of two sequences beside that of `rays`, at most 64; area lights
  uint64_t seed = 0;
  bool clear = false;  ///< what light passes straight on is not there: it is the same for all candidates (trace/solid_scene.h)
};
/// Term "shadow_probe", domain Table, an element per view sample of the judged pixels: planes P, N, Ng f32x3 (N is Ng), instance u32 (a G-buffer for shadow
/// lookups); lit f32: 1 where the light can shine. Of a pixel's first element: a, b f32: two independent halves of the pixel's true visibility ((V - a)(V - b)
/// is free of the truth's own noise in the mean); weight f64, stratum u32: ProbePixel's. Planes mse, variance f64: mean squared error over what the light can
/// shine on of each ray count, and the variance of that estimate (first elements); barely, barely_variance f64: the part of that where little of an area light
/// can shine, so that few rays may say "none", which is visibility 1; share f64: share of the pixels that show a receiver (first element); x, y u32: a pixel's
/// place (its first element).
NodePtr makeShadowProbeNode(const ShadowProbeSettings& settings);
/// Rays that it takes, at most.
double shadowProbeRays(const ShadowProbeSettings& settings);

struct MapProbeSettings {
  ProbeMap map;
  float bias = 0.0005f, slopeBias = 1.0f;
  bool clear = false;  ///< as the shadow probe's
};
/// Term "visibility" over the elements of input "shadow_probe", plane V f32: bilinear comparisons with a virtual map.
NodePtr makeMapProbeNode(const MapProbeSettings& settings);

/// Term "probe_errors", planes mse and variance f64 (as the shadow probe's): of what input 1, "visibility" over the elements of input 0, "shadow_probe", says.
/// Plane work f64, where input 1 has one: its mean over the view samples of the picture. A small output.
NodePtr makeProbeErrorsNode(int viewSamples);

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// How large the errors of a technique are that filters over neighbours, which no single pixel can say: small windows of the picture around some of the pixels
// that a shadow probe judged, made by the technique's own nodes, some pixels of which are held against rays.
//
// Which pixels: drawn from the probe's with probabilities proportional to what they stand for and to how wide a penumbra they show (Hansen and Hurwitz 1943:
// with replacement, systematically), so that
//     mean over windows of weight * mean of f over the window's core     has the mean of f over the picture as its expectation
// (but for the picture's rim), and the spread of its terms says its variance.
// Cost: windows * (2 radius + 1)^2 view rays per view sample, and what the technique takes over as many; rays of the truth. Error: where filters are wider than
// a window leaves room for they average less than in the picture: errors are rather too large.
#pragma once

#include "scene/camera.h"
#include "terms/node.h"

namespace gobo {
inline namespace filters {

constexpr uint32_t kWindowTruthRays = 16;  ///< per view sample, of each half

struct ProbeWindowsSettings {
  Camera camera;
  int width = 0, height = 0, viewSamples = 1;  ///< of the picture
  int judged = 128;                            ///< pixels of the shadow probe
  int windows = 24, radius = 13;
  uint64_t seed = 0;
  int side() const { return 2 * radius + 1; }
  Extent extent() const { return {side(), side(), windows * viewSamples}; }
};
/// Input 0: "shadow_probe". Term "probe_windows", domain ViewSample, side x side x (windows * viewSamples): layer w * viewSamples + s is view sample s of
/// window w. Planes P, N, Ng f32x3, footprint f32, instance u32: a G-buffer for shadow techniques; inside u8: 0 outside the picture, where nothing is. Of
/// pixels that are judged: lit f32: 1 where most of the light can shine on a view sample (where little can, few rays say "none" and visibility is 1,
/// with a filter or without); a, b f32: two independent halves of the truth (a window's first
/// layer); noise f32x4: an estimate of the squared error of 1, 4, 8 and 16 rays (a window's first layer).
/// weight f64: of a window's first element.
NodePtr makeProbeWindowsNode(const ProbeWindowsSettings& settings);
/// Rays of its truth.
double probeWindowsRays(const ProbeWindowsSettings& settings);

struct WindowErrorsSettings {
  ProbeWindowsSettings windows;  ///< camera and seed do not count
  uint32_t rays = 4;             ///< what the filter is compared with, at most kWindowTruthRays
};
/// Inputs 0: "probe_windows"; 1: "visibility" over its elements, plane V f32; 2: "shadow_filter_maps" of that (axis_aligned/maps.h). Term "window_errors":
/// planes ratio, variance f64: mean squared error of the filter over that of `rays` rays without it, and the variance of that (a ratio estimate: what of both
/// depends on how much penumbra the windows hold falls out); ratio < 0: the windows hold no noise. work f64x2: share of the picture's view samples that
/// the filter changes, and mean over all of them of its taps. A small output.
NodePtr makeWindowErrorsNode(const WindowErrorsSettings& settings);

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// The published method and its released code by the names of their differences (digest of Wang, UCB/EECS-2013-118, section 8c), for reproducing them and for
// taking apart what each costs: `shadow_bench modes`. Not in the request's schema: what a request says is technique.h.
//
//   beta        report_corrected: beta = (1/k) max(sigma s2 / mu, d d1/d2max), no cut; code: k = sqrt 6, weights cut at 1/Omega
//   n           eq3.5: as printed; capped: both frequencies by what a pixel can hold. Both are limited to the pilot and `maxSamples`
//   thresholds  report: |beta' - beta| alone; code: absolute ones, in rad/m and square metres; scale_free
//   distance    light_plane: as published; world; ours: along the lines to the light's centre
//   filter      separable; full2d
//   light       gaussian_truncated: the code's, a square whose half side is sigma; gaussian: all of it; uniform: sigma of the same variance
//   shade       centre: visibility weighs the light's points alike, for unshadowed light from the light's centre; ratio: as their light arrives
#pragma once

#include <string_view>

#include "filters/axis_aligned/filter.h"
#include "filters/shadow_technique.h"
#include "terms/shadow_light_profile.h"

namespace gobo {
inline namespace filters {

struct AxisAlignedModes {
  bool codeBeta = false;
  bool printedRate = false;
  AxisAlignedThresholds thresholds = AxisAlignedThresholds::ScaleFree;
  AxisAlignedDistance distance = AxisAlignedDistance::Line;
  bool full2d = false;
  ShadowLightProfile profile;

  float k = 3.0f, mu = 1.0f;  ///< k: of report_corrected
  uint32_t uniform = 0;       ///< not 0: this many rays everywhere
  float meanSamples = 0;      ///< not 0, and uniform 0: mu is solved for it
  uint32_t pilot = 9, maxSamples = 256;
  int radiusPx = 32, dilatePx = 10;
};

/// `text`: "name=value" by commas, names and values as above; what is not named stays. Errors: InvalidArgument with the word that is not known.
Result<AxisAlignedModes> axisAlignedModes(std::string_view text, AxisAlignedModes modes = {});
/// Standard deviation of the light under these modes: half a side of Gaussians (the mean of both axes), by its variance of uniform ones.
float sigmaOf(const LightShape& shape, const AxisAlignedModes& modes);
/// Adds pilot, dilation, rates and filter by `modes`. Errors: InvalidArgument for lights without a plane, and Gaussians of other lights than rectangles.
Result<NodeId> planAxisAlignedModes(Graph& graph, const ShadowInput& input, const AxisAlignedModes& modes);

}  // namespace filters
}  // namespace gobo

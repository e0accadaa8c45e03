// SPDX-License-Identifier: Apache-2.0
// shadows.auto: technique and parameters by measured error and modelled cost.
//
// A probe (shadow_probe.h) measures the error of each candidate on some pixels of the view, most of them near edges of shadows (probe_pixels.h); the cost of
// each is a sum of constants (candidates.cpp). Within `error` the cheapest wins whose error, and a standard error of what is known of it, keeps it; with
// `time_ms` the one of least error among those that fit; if none does, the nearest miss. A first look takes some hundred pixels; closer ones follow where a
// cheaper candidate may keep the error too and what it would save is worth the look (decision.h). Costs are constants, not measurements of the running machine,
// so that the same request picks the same technique everywhere and the picture's bits do not depend on load. Candidates: shadow rays; percentage-closer maps
// (hard); for area lights percentage-closer soft maps with few and many taps, and axis-aligned filtering of 4 to 16 rays. Hard maps are judged by rays through
// the texels that they would read; soft ones are made and looked up at the probe's pixels (if one wins, the picture finds it in the store), the smallest first
// and those that cannot keep the error, by what smaller ones say, not at all; their times follow from what the lookups read there. Filters average over
// neighbours: they are run on small windows about some of the probe's pixels (probe_windows.h), and their error is that of as many rays times the ratio of both
// there. What there is to make or filter waits until closer looks at rays, and at cheaper ones of its kind, are no longer worth it. Hard shadows are judged
// over the area of pixels: a ray per view sample is exact where it looks and has the staircase of the pixels as its error. Looks are terms: a request of the
// same light and view finds them in the store. Cost: 7000 rays for a first look at hard shadows, 9000 at soft ones, at most 136 000 for the closest (soft: 310
// 000, where that is a small part of the choice); maps; 107 000 rays for the windows of a filter of 4. Failure cases: errors in a corner that no look sees;
// lights behind clear panes, where filtering is no candidate; convolution soft maps are none either (docs/shadow_maps.md).
#pragma once

#include <functional>

#include "filters/shadow_technique.h"

namespace gobo {
inline namespace filters {

struct AutomaticCandidate {
  v1::ShadowTechnique technique;  ///< with map settings
  std::string text;               ///< "percentage_closer, 1024 texels"
  double rmse = 0, ms = 0;        ///< predicted: error of visibility, time of the light's nodes
  std::vector<double> work;       ///< of a view sample; soft maps: SoftWork (filters/soft_shadow/soft_kernels.h), filters: window_errors' (probe_windows.h)
  bool judged = true;             ///< false: too dear to win, or to be judged; its error was not asked for
};
struct AutomaticChoice {
  std::vector<AutomaticCandidate> candidates;
  size_t chosen = 0;
  double receivers = 0;  ///< share of the picture that the light can shine on; 0: the choice needed no probe
};

/// `expand` evaluates a node of the graph while planning. Where it gives no term, all candidates come back unjudged. Errors: those of the probe.
Result<AutomaticChoice> chooseShadow(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique,
                                     const std::function<Result<TermPtr>(const Graph&, NodeId)>& expand);

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// shadows.auto: technique and parameters by measured error and modelled cost.
//
// A probe (shadow_probe.h) measures the error of each candidate on some pixels of the view; the cost of each is a sum of the
// figures below. Within `error` the cheapest wins; with `time_ms` the one of least error among those that fit; if none does, the nearest
// miss. Costs are constants, not measurements of the running machine, so that the same request picks the same technique everywhere and the
// picture's bits do not depend on load. Candidates: shadow rays; percentage-closer maps (hard); soft maps (area lights).
// Probe: a few hundred pixels; a hard candidate map costs 4 rays a view sample, a soft one at most 136. Candidates that cannot win by their time are not
// judged.
#pragma once

#include <functional>

#include "filters/shadow_technique.h"

namespace gobo::inline filters {

struct AutomaticCandidate {
  v1::ShadowTechnique technique;  ///< with map settings
  std::string text;               ///< "percentage_closer, 1024 texels"
  double rmse = 0, ms = 0;        ///< predicted: error of visibility, time of the light's nodes
  bool judged = true;             ///< false: too dear to win, its error was not asked for
};
struct AutomaticChoice {
  std::vector<AutomaticCandidate> candidates;
  size_t chosen = 0;
  double receivers = 0;  ///< share of the picture that the light can shine on; 0: the choice needed no probe
};

/// `expand` evaluates a node of the graph while planning. Where it gives no term, all candidates come back unjudged. Errors: those of the probe.
Result<AutomaticChoice> chooseShadow(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique,
                                     const std::function<Result<TermPtr>(const Graph&, NodeId)>& expand);

}  // namespace gobo::inline filters

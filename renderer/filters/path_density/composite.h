// SPDX-License-Identifier: Apache-2.0
// The picture of weighed samples and what was left out of it (path_density.h), by a box filter a pixel wide; sums in double, in the order of the samples.
#pragma once

#include <functional>

#include "filters/path_density/neighbour_search.h"
#include "filters/path_density/path_density.h"

namespace gobo::pathdensity {

class Composite {
 public:
  /// Which must live as long.
  Composite(const SampleView& samples, const SampleBins& bins, const Settings& settings);
  using ExactSigma = std::function<float(size_t sorted, NeighbourSearch::Scratch&)>;
  /// Adds a term. sigma: sorted, right as far as weights go; `exact` tells it to its end, for pixels all of whose samples are rejected.
  /// judged: weights and densities of this term count for their maps. False: stopped.
  bool add(LightTerm term, const std::vector<float>& sigma, const ExactSigma& exact, bool judged, const TaskArena& arena, const StopToken& stop);
  Filtered finish();

 private:
  void fillEmpty();
  const SampleView& samples_;
  const SampleBins& bins_;
  const Settings& settings_;
  std::vector<double> kept_, first_, rejected_;  // of one term
  std::vector<double> sumKept_, sumFirst_, sumRejected_, weight_, density_;
  int terms_ = 0;  // judged
  Filtered out_;
};

}  // namespace gobo::pathdensity

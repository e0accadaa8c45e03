// SPDX-License-Identifier: Apache-2.0
// What `gobo environment --method published` says of a map beside its split: pictures of it, and Haar wavelets beside harmonics.
#pragma once

#include "techniques/transfer/environment_report.h"
#include "techniques/transfer/published/haar.h"
#include "techniques/transfer/published/published_split.h"

namespace gobo::transfer::published {

struct PublishedReport {
  PublishedSplit split;
  /// As ours has it, so that it is drawn alike. `whole`: the map and its harmonics without a window. `rest`: the harmonics that are rendered, and as radiance
  /// what they and the lights' disks give together; its error is that of this model.
  EnvironmentReport pictures;
};
/// 2 to 10 bands. Empty (`split.full`) if `stop` fired first.
PublishedReport reportPublished(const Environment& map, const PublishedSettings& settings, const TaskArena& arena, const StopToken& stop = {});

/// L2 norm of the luminance that harmonics (bands^2 x 3) miss of the cells, by that of the cells: what CubeHaar::error is of as many numbers.
double harmonicsError(const EnvironmentCells& cells, const std::vector<double>& coefficients, int bands);

}  // namespace gobo::transfer::published

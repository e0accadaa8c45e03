// SPDX-License-Identifier: Apache-2.0
// A map without the peaks that have shadows of their own, for the nodes that make something of it.
#pragma once

#include <span>

#include "techniques/transfer/gloss_levels.h"
#include "terms/environment_cells.h"
#include "terms/extract_lights.h"

namespace gobo::subtractive {

inline constexpr size_t kResidualTexels = size_t(transfer::kGlossLevels[0].width) * transfer::kGlossLevels[0].height;
inline constexpr size_t kResidualBytes = 64 * kResidualTexels;  ///< held by who makes one and extracts lights of it
inline constexpr int kSplitCells = 6 * EnvironmentCells::kSide * EnvironmentCells::kSide;

/// In its own axes, 512 x 256. `left`: of the term "environment_split". Null if `stop` fired first.
EnvironmentPtr residualMap(const Environment& map, std::span<const float> left, const TaskArena& arena, const StopToken& stop);

}  // namespace gobo::subtractive

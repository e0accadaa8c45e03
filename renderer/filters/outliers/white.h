// SPDX-License-Identifier: Apache-2.0
// The luminance that counts as white where nobody says one: what estimators by colour or brightness measure by.
#pragma once

#include <span>

#include "base/status.h"
#include "base/stop.h"
#include "base/task_arena.h"

namespace gobo::outliers {

/// 1 / 0.18 of the median luminance of the pixels that have light, in the 3 x 3 median of the picture (RGB, width * height * 3), by which single bright
/// samples do not matter; 1 where no pixel has any. Errors: Cancelled.
Result<float> whiteOf(std::span<const float> rgb, int width, int height, const TaskArena& arena, const StopToken& stop = {});

}  // namespace gobo::outliers

// SPDX-License-Identifier: Apache-2.0
// Combined correlated and importance sampling (filters/outliers/combined_sampling.h) where it is for: direct light of a lamp on a diffuse floor, whose light
// without the ball before it is known in closed form (Lambert's polygon), against path density and trimmed means on the same samples. RMSE by what the
// floor sees of the lamp: all of it, a part, nothing; relative to the mean radiance of the picture.
#pragma once

#include "base/task_arena.h"

namespace gobo::pathdensitybench {

int combinedSampling(const TaskArena& arena);

}  // namespace gobo::pathdensitybench

// SPDX-License-Identifier: Apache-2.0
// Rival of the filters: joint bilateral filtering of a noisy ray-traced visibility by position and normal (Petschnigg et al. 2004), and
// its a-trous form (Dammertz et al. 2010). What a user would write in an afternoon around a ray tracer.
#pragma once

#include <vector>

#include "base/task_arena.h"
#include "terms/term.h"

namespace gobo::shadowbench {

/// radius > 0: one pass over (2 radius + 1)^2 pixels, sigma = radius / 1.5; -1: three passes of 5 x 5 with steps 1, 2, 4. `gbuffer` has one
/// view sample. Weights: Gaussian in the picture, dot(N, N')^32, (1 + (distance from the tangent plane / (2 footprints))^2)^-2.
std::vector<float> jointBilateral(const TaskArena& arena, const Term& gbuffer, const std::vector<float>& V, int radius);

}  // namespace gobo::shadowbench

// SPDX-License-Identifier: Apache-2.0
// Gives rejected light back to the pixels around, so that energy is not lost and no pixel glares: every pixel's rejected light goes to those under a Gaussian,
// in proportion to the light that they have kept:
//   out(p) = kept(p) (1 + clamp(sum_q G(p - q) rejected(q) / sum_r G(r - q) |kept(r)|, -1, most))
// Edges stay, as dark pixels get little; all energy comes back, but for what the bound cuts off, so that one sample, whatever its light, changes no pixel by
// more than that factor. By channel.
#pragma once

#include <vector>

#include "base/stop.h"
#include "base/task_arena.h"

namespace gobo::pathdensity {

/// Moves light from `rejected` to `kept` (RGB, width * height * 3). sigma > 0 in pixels, cut off at three; most >= 0. False: stopped.
bool spreadRejected(std::vector<double>& kept, std::vector<double>& rejected, int width, int height, double sigma, double most, const TaskArena& arena,
                    const StopToken& stop);

}  // namespace gobo::pathdensity

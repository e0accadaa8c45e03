// SPDX-License-Identifier: Apache-2.0
// An environment map in spherical harmonics: the exact integrals of its bilinear look-up (scene/environment_tents.h). In azimuth a tent takes a factor
// off each order; in the polar angle tents are integrated by Gauss's rule in pieces of at most 3 degrees. Double; one order of summation whatever the threads.
#pragma once

#include <vector>

#include "base/stop.h"
#include "base/task_arena.h"
#include "scene/environment.h"

namespace gobo::transfer {

/// bands^2 x 3 coefficients in the map's axes (rotation 0). Empty if `stop` fired first. O(texels x bands).
std::vector<double> environmentHarmonics(const Environment& map, int bands, const TaskArena& arena, const StopToken& stop = {});

}  // namespace gobo::transfer

// SPDX-License-Identifier: Apache-2.0
// A map prefiltered for Phong's lobe (Heidrich, Seidel 1999): the mean radiance
//   P(r) = integral of L(w) max(r . w, 0)^s dw / integral of max(r . w, 0)^s dw,   the latter 2 pi / (s + 1),
// for every mirror direction r of a lat-long map, in the map's axes. Both integrals are sums over the same pieces, so a constant map stays constant to
// rounding, and for s to infinity each direction has the radiance of the piece nearest to it.
// Pieces are texels, or where the lobe is much wider than they are, blocks of them: less than an eighth of the lobe's standard deviation across.
#pragma once

#include <vector>

#include "base/stop.h"
#include "base/task_arena.h"
#include "scene/environment.h"

namespace gobo::prefilter {

struct PhongMap {
  int width = 0, height = 0;
  std::vector<DVec3> radiance;  ///< row-major, at texels' centres; of the lobe about them
};

/// `exponent` > 0. Nothing in it if `stop` fired first. The same bits for any arena.
/// Cost: about 3 ns x texels of the result x pieces within the lobe.
PhongMap phongMap(const Environment& map, double exponent, int width, int height, const TaskArena& arena, const StopToken& stop = {});

}  // namespace gobo::prefilter

// SPDX-License-Identifier: Apache-2.0
// An icosahedron whose triangles are cut into four `level` times: 10 * 4^level + 2 unit directions, nearly even, each with its five or six neighbours.
#pragma once

#include <array>
#include <vector>

#include "base/vec.h"

namespace gobo::transfer {

struct Icosphere {
  std::vector<DVec3> vertices;
  std::vector<std::array<int, 6>> neighbours;  ///< [5] is -1 at the twelve vertices of five
};
/// Level 0 .. 7. The same object always.
const Icosphere& icosphere(int level);

}  // namespace gobo::transfer

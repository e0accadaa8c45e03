// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "base/array.h"
#include "base/vec.h"

namespace gobo::transfer {

/// Whether a mesh is a solid body that faces outwards, whose back faces nobody outside of it sees: along each edge as many triangles go one way as the other
/// (so it has no rim, and no triangle that is turned over), and its volume is positive. Positions that are equal but for rounding are one
/// (scene/mesh_filters/weld.h). Of several bodies: all of them closed, and their volume in sum. O(triangles log triangles).
bool hidesBacks(const Array<uint32_t>& indices, const Array<Vec3>& positions);

}  // namespace gobo::transfer

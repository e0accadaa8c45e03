// SPDX-License-Identifier: Apache-2.0
// LightFacet: a triangle of a mesh light, for who sums over all of them instead of drawing one.
#pragma once

#include "base/vec.h"

namespace gobo {
inline namespace trace {

struct LightFacet {
  Vec3 p, e1, e2;  ///< world: a corner and the edges from it
  Vec3 n;          ///< unit, to the side that shines
};

}  // namespace trace
}  // namespace gobo

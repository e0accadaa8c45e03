// SPDX-License-Identifier: Apache-2.0
// How far away things may be. Squares of cross products are the highest powers of lengths that geometry takes in single precision:
// within this bound they are at most 1.1e38, below the largest float.
#pragma once

#include <cmath>

#include "base/vec.h"

namespace gobo {
inline namespace scene {

/// Metres, of every coordinate of a scene, a pose, a patch and a request; factors of transforms alike. The schema's ranges of lengths agree.
inline constexpr float kLargestCoordinate = 1e9f;

inline bool isCoordinate(float x) { return std::fabs(x) <= kLargestCoordinate; }  // false for NaN
inline bool isCoordinate(const Vec2& v) { return isCoordinate(v.x) && isCoordinate(v.y); }
inline bool isCoordinate(const Vec3& v) { return isCoordinate(v.x) && isCoordinate(v.y) && isCoordinate(v.z); }
inline bool isCoordinate(const DVec3& v) {
  return std::fabs(v.x) <= double(kLargestCoordinate) && std::fabs(v.y) <= double(kLargestCoordinate) && std::fabs(v.z) <= double(kLargestCoordinate);
}
inline bool isCoordinate(const Mat4& m) {
  for (int c = 0; c < 4; ++c)
    for (int r = 0; r < 4; ++r)
      if (!isCoordinate(m[c][r])) return false;
  return true;
}

}  // namespace scene
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Points of the unit disk.
#pragma once

#include <cmath>

#include "base/vec.h"

namespace gobo {
inline namespace base {

/// Area-preserving map of the square to the unit disk (Shirley & Chiu 1997): keeps strata compact.
inline Vec2 concentricDisk(const Vec2& u) {
  const float a = 2.0f * u.x - 1.0f, b = 2.0f * u.y - 1.0f;
  if (a == 0.0f && b == 0.0f) return Vec2(0.0f);
  const bool wide = std::fabs(a) > std::fabs(b);
  const float r = wide ? a : b;
  const float phi = wide ? 0.25f * kPi * (b / a) : 0.5f * kPi - 0.25f * kPi * (a / b);
  return Vec2(r * std::cos(phi), r * std::sin(phi));
}

}  // namespace base
}  // namespace gobo

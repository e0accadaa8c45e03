// SPDX-License-Identifier: Apache-2.0
// What a straight edge leaves of a sun: a uniform disk cut by a line.
#pragma once

#include <cmath>

namespace gobo::test {

inline constexpr double kDegree = M_PI / 180;

/// The visible part of the disk, 0 to 1, where the edge is `d` disk radii from its centre (-1: all hidden, 1: all seen).
inline double segment(double d) { return d >= 1 ? 1 : d <= -1 ? 0 : 1 - (std::acos(d) - d * std::sqrt(1 - d * d)) / M_PI; }

}  // namespace gobo::test

// SPDX-License-Identifier: Apache-2.0
// Floating point to integer where the value is not known to fit: what does not is clamped, NaN is the lowest. A plain conversion of such
// a value is undefined, and an index made of it lies anywhere.
#pragma once

#include <algorithm>
#include <cstdint>
#include <type_traits>

namespace gobo {
inline namespace base {

/// `v` towards zero, within lo .. hi (lo <= hi); lo for NaN.
template <typename F>
requires std::is_floating_point_v<F>
constexpr int toInteger(F v, int lo, int hi) {
  if (!(v > F(lo))) return lo;
  return v >= F(hi) ? hi : std::clamp(int(v), lo, hi);  // F(hi) may be rounded up; a v below it still fits an int
}

/// Cell of `v` in 0 .. n - 1 (n > 0): 0 for NaN and what is below, n - 1 for what is above.
template <typename F>
requires std::is_floating_point_v<F>
constexpr int toIndex(F v, int n) { return toInteger(v, 0, n - 1); }

}  // namespace base
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Milliseconds of calls, and their quantiles.
#pragma once

#include <algorithm>
#include <chrono>
#include <vector>

namespace gobo::bench {

inline double millisSince(std::chrono::steady_clock::time_point from) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - from).count();
}

/// Sorts; 0 of none.
inline double quantile(std::vector<double>& v, double q) {
  if (v.empty()) return 0;
  std::sort(v.begin(), v.end());
  return v[std::min(v.size() - 1, size_t(q * double(v.size())))];
}

}  // namespace gobo::bench

// SPDX-License-Identifier: Apache-2.0
// Per-pixel estimators of squared error from two independent halves A and B of the truth. Pure; any thread.
#pragma once

#include "base/vec.h"

namespace gobo {

inline constexpr double kRelMseEpsilon = 1e-2;

/// Mean over channels of (A - p)(B - p): unbiased for mean (truth - p)^2, whatever the noise of the halves.
inline double squaredErrorOfHalves(const Vec3& p, const Vec3& a, const Vec3& b) {
  double sum = 0;
  for (int c = 0; c < 3; ++c) sum += (double(a[c]) - p[c]) * (double(b[c]) - p[c]);
  return sum / 3;
}

/// Mean over channels of (truth - p)^2 / (truth^2 + epsilon), estimated as 2 g((A+B)/2) - (g(A) + g(B))/2, the two-group
/// jackknife (Quenouille 1956), which for g = (x - p)^2 is exactly (A - p)(B - p) and for this g loses the noise's second
/// and third order. Dividing (A - p)(B - p) by an estimate from the same halves instead is biased already at second order.
inline double relativeErrorOfHalves(const Vec3& p, const Vec3& a, const Vec3& b) {
  double sum = 0;
  for (int c = 0; c < 3; ++c) {
    const auto g = [&](double x) { return (x - p[c]) * (x - p[c]) / (x * x + kRelMseEpsilon); };
    sum += 2 * g(0.5 * (double(a[c]) + double(b[c]))) - 0.5 * (g(a[c]) + g(b[c]));
  }
  return sum / 3;
}

}  // namespace gobo

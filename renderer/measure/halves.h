// SPDX-License-Identifier: Apache-2.0
// Per-pixel estimators of squared error from two independent halves A and B of the truth. Pure; any thread.
#pragma once

#include "base/vec.h"

namespace gobo {
inline namespace measure {

inline constexpr double kRelMseEpsilon = 1e-2;

/// Mean over channels of (A - p)(B - p): unbiased for mean (truth - p)^2, whatever the noise of the halves.
inline double squaredErrorOfHalves(const Vec3& p, const Vec3& a, const Vec3& b) {
  double sum = 0;
  for (int c = 0; c < 3; ++c) sum += (double(a[c]) - p[c]) * (double(b[c]) - p[c]);
  return sum / 3;
}

/// Mean over channels of (truth - p)^2 / (truth^2 + epsilon), which no function of noisy halves estimates without bias
/// (it is no polynomial in the truth). Two estimators of different bias; certify takes the hull of
/// their intervals:
struct RelativeError {
  double leaning;    ///< (A - p)(B - p) / (q^2 + epsilon), q = p + k (M - p), M = (A + B) / 2, k = |M - p|^2 / (|M - p|^2 + 4 |A - B|^2 / 4):
                     ///< the denominator leans on the picture where the halves cannot tell it from the truth, so that their
                     ///< noise does not enter both factors. Bounded; bias of second order where noise and error are alike.
  double jackknife;  ///< 2 g(M) - (g(A) + g(B)) / 2, g(x) = (x - p)^2 / (x^2 + epsilon) (Quenouille 1956, two groups): the
                     ///< second order cancels, but noise far above sqrt(epsilon) blows the rest up.
};
inline RelativeError relativeErrorOfHalves(const Vec3& p, const Vec3& a, const Vec3& b) {
  double noise = 0, distance = 0;
  for (int c = 0; c < 3; ++c) {
    const double d = 0.5 * (double(a[c]) - b[c]), m = 0.5 * (double(a[c]) + b[c]) - p[c];
    noise += d * d, distance += m * m;
  }
  const double k = distance > 0 ? distance / (distance + 4 * noise) : 1;
  RelativeError out{0, 0};
  for (int c = 0; c < 3; ++c) {
    const double pc = p[c], ac = a[c], bc = b[c], middle = 0.5 * (ac + bc), q = pc + k * (middle - pc);
    const auto g = [pc](double x) { return (x - pc) * (x - pc) / (x * x + kRelMseEpsilon); };
    out.leaning += (ac - pc) * (bc - pc) / (q * q + kRelMseEpsilon) / 3;
    out.jackknife += (2 * g(middle) - 0.5 * (g(ac) + g(bc))) / 3;
  }
  return out;
}

}  // namespace measure
}  // namespace gobo

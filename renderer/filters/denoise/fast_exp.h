// SPDX-License-Identifier: Apache-2.0
// Exponential and logarithm for weights, in loops that have to vectorise (std::exp calls a function for each element).
// Both reduce to a power of two and a polynomial: no table, no branch, no rounding mode but the nearest. The same bits in vectors and alone.
//   fastExp: relative error < 2e-7 in -87 .. 0; exactly 1 at 0; exactly 0 below -87 (where floats run out), at -inf and for NaN.
//   fastLog: error < 2e-7 (absolute near 1, where it is exactly 0 at 1; relative elsewhere), for normal numbers > 0.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>

namespace gobo::denoise {

/// e^x for x <= 0.
inline float fastExp(float x) {
  constexpr float kPerLn2 = 1.44269504f, kRound = 12582912.0f;         // 1.5 * 2^23: adding it leaves an integer in the low bits
  constexpr float kLn2High = 0.693359375f, kLn2Low = -2.12194440e-4f;  // the first times an integer below 2^14 is exact
  const float bounded = x > -87.0f ? x : -87.0f;                       // NaN as well
  const float shifted = bounded * kPerLn2 + kRound, k = shifted - kRound;
  const float r = (bounded - k * kLn2High) - k * kLn2Low;  // |r| <= ln 2 / 2
  // 1 + r + r^2 q(r): q through the Chebyshev nodes of the interval, 1e-8.
  const float q = (((1.39262009e-3f * r + 8.36323283e-3f) * r + 4.16665544e-2f) * r + 0.166665767f) * r + 0.5f;
  const float p = 1.0f + (r + r * r * q);
  const float e = std::bit_cast<float>(std::bit_cast<uint32_t>(p) + (std::bit_cast<uint32_t>(shifted) << 23));
  return x > -87.0f ? e : 0.0f;
}

/// Natural logarithm of a normal number > 0.
inline float fastLog(float x) {
  constexpr int32_t kRootHalf = 0x3f3504f3;  // bits of sqrt(1/2): the mantissa is taken from there to sqrt(2)
  const int32_t bits = std::bit_cast<int32_t>(x), k = (bits - kRootHalf) >> 23;
  const float m = std::bit_cast<float>(bits - k * (1 << 23));
  // 2 artanh(s) = ln((1 + s) / (1 - s)), |s| < 0.1716: the series ends at 3e-8.
  const float s = (m - 1.0f) / (m + 1.0f), t = s * s;
  return float(k) * 0.693147181f + s * (2.0f + t * (0.666666667f + t * (0.4f + t * 0.285714286f)));
}

}  // namespace gobo::denoise

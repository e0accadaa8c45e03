// SPDX-License-Identifier: Apache-2.0
#include "base/sobol.h"

#include <array>

#include "base/check.h"

namespace gobo {
inline namespace base {
namespace {

using Directions = std::array<uint32_t, 32>;

/// Direction numbers from a primitive polynomial of degree s with inner coefficients `a` and initial odd numbers m
/// (Joe & Kuo 2008, equation 2).
constexpr Directions directions(int s, uint32_t a, std::array<uint32_t, 3> m) {
  Directions v{};
  for (int k = 0; k < 32; ++k) {
    if (k < s) {
      v[k] = m[k] << (31 - k);
      continue;
    }
    v[k] = v[k - s] ^ (v[k - s] >> s);
    for (int j = 1; j < s; ++j) {
      if ((a >> (s - 1 - j)) & 1u) v[k] ^= v[k - j];
    }
  }
  return v;
}

constexpr Directions kDimension2 = directions(2, 1, {1, 3, 0});
constexpr Directions kDimension3 = directions(3, 1, {1, 3, 1});

}  // namespace

uint32_t sobolBits(uint32_t index, int dimension) {
  GOBO_CHECK_LE(0, dimension);
  GOBO_CHECK_LT(dimension, 4);
  if (dimension == 0) return reverseBits(index);
  if (dimension == 1) return reverseBits(pascalDigits(index));
  const Directions& v = dimension == 2 ? kDimension2 : kDimension3;
  uint32_t bits = 0;
  for (; index; index &= index - 1) bits ^= v[__builtin_ctz(index)];
  return bits;
}

}  // namespace base
}  // namespace gobo

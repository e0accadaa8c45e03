// SPDX-License-Identifier: Apache-2.0
// Owen-scrambled Halton points (Halton 1960; Owen 2017 for the scramble). Every value is a pure function of its arguments.
//
// The digits of a sample's number in base b, mirrored at the point, are a fraction; dimensions take different primes for b. Each digit is permuted by
// random numbers of its own for every string of digits before it, so that each point is uniform and b^k consecutive ones from a multiple of b^k on have
// one in each interval of length b^-k. Permutations are a digit^n + c modulo b with n prime to b - 1: any two digits go to any two
// others equally often, and no more enters the variance of a nested scramble (Owen 1997); n > 1, or a few samples in a large base would be equidistant, at
// times all in a small part of the interval.
#pragma once

#include "base/vec.h"

namespace gobo {
inline namespace base {

/// Pairs of dimensions that have primes of their own: film and 64 scattering events after the first of 4 pairs each. Pairs beyond are independent
/// numbers: a prime used twice would tie two dimensions' first digits to each other, and the error would no longer go to zero.
inline constexpr uint32_t kHaltonPairs = 261;

/// Prime of pair `pair`'s first (0) or second (1) dimension: 2 and 3, 5 and 7, ...
uint32_t haltonPrime(uint32_t pair, int second);

/// The fraction itself, in 32-bit fixed point rounded down: what is scrambled.
uint32_t radicalInverse(uint32_t index, uint32_t base);
/// Scrambled, for a prime below 4096. O(digits of `index`).
uint32_t scrambledRadicalInverse(uint32_t index, uint32_t base, uint64_t scramble);

/// Pair `pair` of sample `index`; [0,1) with 24 bits.
Vec2 haltonPoint(uint64_t seed, uint32_t index, uint32_t pair);
/// Its first dimension alone.
float haltonValue(uint64_t seed, uint32_t index, uint32_t pair);

/// As SobolSampler: draws of one sample in turn. A 1D draw is a pair's first dimension.
class HaltonSampler {
 public:
  HaltonSampler(uint64_t seed, uint32_t index) : seed_(seed), index_(index) {}
  float next1D() { return haltonValue(seed_, index_, pair_++); }
  Vec2 next2D() { return haltonPoint(seed_, index_, pair_++); }

 private:
  uint64_t seed_;
  uint32_t index_, pair_ = 0;
};

}  // namespace base
}  // namespace gobo

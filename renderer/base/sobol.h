// SPDX-License-Identifier: Apache-2.0
// Counter-based random numbers and Owen-scrambled Sobol points. Every value is a pure function of its arguments.
#pragma once

#include <cstdint>

#include "base/vec.h"

namespace gobo {

/// Avalanche hash of 64 bits (SplitMix64 finaliser).
inline uint64_t mix64(uint64_t x) {
  x ^= x >> 30; x *= 0xbf58476d1ce4e5b9ull;
  x ^= x >> 27; x *= 0x94d049bb133111ebull;
  return x ^ (x >> 31);
}
inline uint64_t hash64(uint64_t a, uint64_t b) { return mix64(a + 0x9e3779b97f4a7c15ull * (b + 1)); }
inline uint32_t hash32(uint64_t a, uint64_t b) { return uint32_t(hash64(a, b) >> 32); }
/// [0,1) with 24 bits; never 1.
inline float toUnit(uint32_t bits) { return float(bits >> 8) * 0x1p-24f; }

/// Sobol point `index` of dimension 0..3 (32-bit fixed point).
uint32_t sobolBits(uint32_t index, int dimension);
/// Owen-scrambles a 32-bit fixed-point value (hash-based nested uniform scramble; Laine-Karras with the constants of
/// Burley 2020's follow-up by Vegdahl).
uint32_t owenScramble(uint32_t bits, uint32_t seed);

/// Padded 2D/1D draws of sample `index` of a scrambled sequence: dimension sets are decorrelated by shuffling the index
/// with a seed of their own (Burley 2020), so any number of dimensions may be drawn.
class SobolSampler {
 public:
  SobolSampler(uint64_t seed, uint32_t index) : seed_(seed), index_(index) {}
  float next1D();
  Vec2 next2D();

 private:
  uint64_t seed_;
  uint32_t index_;
  uint32_t dimension_ = 0;
};

}  // namespace gobo

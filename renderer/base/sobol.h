// SPDX-License-Identifier: Apache-2.0
// Counter-based random numbers and Owen-scrambled Sobol points. Every value is a pure function of its arguments.
// Inline because the tracer draws several hundred numbers a sample; about 4 ns for a 1D and 13 ns for a 2D draw.
#pragma once

#include <cstdint>

#include "base/vec.h"

namespace gobo {
inline namespace base {

/// Avalanche hash of 64 bits (SplitMix64 finaliser).
inline uint64_t mix64(uint64_t x) {
  x ^= x >> 30;
  x *= 0xbf58476d1ce4e5b9ull;
  x ^= x >> 27;
  x *= 0x94d049bb133111ebull;
  return x ^ (x >> 31);
}
inline uint64_t hash64(uint64_t a, uint64_t b) { return mix64(a + 0x9e3779b97f4a7c15ull * (b + 1)); }
inline uint32_t hash32(uint64_t a, uint64_t b) { return uint32_t(hash64(a, b) >> 32); }
/// [0,1) with 24 bits; never 1.
inline float toUnit(uint32_t bits) { return float(bits >> 8) * 0x1p-24f; }

inline uint32_t reverseBits(uint32_t x) {
  x = __builtin_bswap32(x);
  x = ((x >> 4) & 0x0f0f0f0fu) | ((x & 0x0f0f0f0fu) << 4);
  x = ((x >> 2) & 0x33333333u) | ((x & 0x33333333u) << 2);
  return ((x >> 1) & 0x55555555u) | ((x & 0x55555555u) << 1);
}

/// Digits of `index` times the Pascal matrix modulo 2, which is the Kronecker power of [[1,1],[0,1]]: five butterflies
/// instead of a loop over 32 direction numbers. Bit-reversed, this is dimension 1 of the Sobol sequence.
inline uint32_t pascalDigits(uint32_t x) {
  x ^= x >> 16;
  x ^= (x >> 8) & 0x00ff00ffu;
  x ^= (x >> 4) & 0x0f0f0f0fu;
  x ^= (x >> 2) & 0x33333333u;
  return x ^ ((x >> 1) & 0x55555555u);
}

/// Sobol point `index` of dimension 0..3 (32-bit fixed point; direction numbers of Joe & Kuo 2008). Dimensions 0 and 1 are
/// closed forms, 2 and 3 loop over the set bits of `index`.
uint32_t sobolBits(uint32_t index, int dimension);

/// A hash whose bit i depends on the bits below i only (Laine & Karras 2011 with Vegdahl's constants), so that it permutes
/// the leaves of a binary tree. Works on bit-reversed fixed point.
inline uint32_t laineKarras(uint32_t x, uint32_t seed) {
  x ^= x * 0x3d20adeau;
  x += seed;
  x *= (seed >> 16) | 1u;
  x ^= x * 0x05526c56u;
  x ^= x * 0x53a22864u;
  return x;
}
/// Owen-scrambles a 32-bit fixed-point value (hash-based nested uniform scramble; Laine-Karras with the constants of
/// Burley 2020's follow-up by Vegdahl).
inline uint32_t owenScramble(uint32_t bits, uint32_t seed) { return reverseBits(laineKarras(reverseBits(bits), seed)); }

/// Padded 2D/1D draws of sample `index` of a scrambled sequence: dimension sets are decorrelated by shuffling the index
/// with a seed of their own (Burley 2020), so any number of dimensions may be drawn. An aligned block of 2^k indices stays
/// a (0,k,2)-net in every 2D draw.
class SobolSampler {
 public:
  SobolSampler(uint64_t seed, uint32_t index) : seed_(seed), index_(reverseBits(index)) {}
  float next1D() {
    const uint64_t h = hash64(seed_, dimension_++);
    const uint32_t shuffled = reverseBits(laineKarras(index_, uint32_t(h >> 32)));
    return toUnit(reverseBits(laineKarras(shuffled, uint32_t(h))));  // dimension 0 reversed is the index itself
  }
  Vec2 next2D() {
    const uint64_t h = hash64(seed_, dimension_++), g = mix64(h ^ 0x9e3779b97f4a7c15ull);
    const uint32_t shuffled = reverseBits(laineKarras(index_, uint32_t(h >> 32)));
    return Vec2(toUnit(reverseBits(laineKarras(shuffled, uint32_t(g)))), toUnit(reverseBits(laineKarras(pascalDigits(shuffled), uint32_t(g >> 32)))));
  }

 private:
  uint64_t seed_;
  uint32_t index_;  // bit-reversed, as the shuffle wants it
  uint32_t dimension_ = 0;
};

}  // namespace base
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// The draws of Sobol points by lane. Integers and exact conversions only: every clone gives the same bits.
#include "trace/sample_set.h"

// A clone for AVX-512, whose registers take all lanes and which multiplies 64 bits. Not under sanitizers, whose runtime is not there yet when clones are
// chosen.
#if defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__) && !defined(GOBO_THREAD_SANITIZER)
#define GOBO_BY_PROCESSOR __attribute__((target_clones("arch=x86-64-v4", "default")))
#else
#define GOBO_BY_PROCESSOR
#endif
#define GOBO_INLINE inline __attribute__((always_inline))

namespace gobo {
inline namespace trace {

namespace {

GOBO_INLINE float unit(uint32_t bits) { return float(int32_t(bits >> 8)) * 0x1p-24f; }  // toUnit, through the signed conversion that vectorises

/// Seeds of a dimension's scrambles: of the order, of both coordinates. Of one sequence, for all lanes.
struct OneScramble {
  uint32_t seeds[3];
  GOBO_INLINE OneScramble(const uint64_t* sequences, uint32_t dimension) {
    const uint64_t h = hash64(sequences[0], dimension), g = mix64(h ^ 0x9e3779b97f4a7c15ull);
    seeds[0] = uint32_t(h >> 32);
    seeds[1] = uint32_t(g);
    seeds[2] = uint32_t(g >> 32);
  }
  GOBO_INLINE uint32_t operator()(int which, int) const { return seeds[which]; }
};
/// By lane.
struct LaneScrambles {
  alignas(64) uint32_t seeds[3][kLanes];
  GOBO_INLINE LaneScrambles(const uint64_t* sequences, uint32_t dimension) {
    for (int i = 0; i < kLanes; ++i) {
      const uint64_t h = hash64(sequences[i], dimension), g = mix64(h ^ 0x9e3779b97f4a7c15ull);
      seeds[0][i] = uint32_t(h >> 32);
      seeds[1][i] = uint32_t(g);
      seeds[2][i] = uint32_t(g >> 32);
    }
  }
  GOBO_INLINE uint32_t operator()(int which, int i) const { return seeds[which][i]; }
};

template <class Scramble>
GOBO_INLINE void point(const Scramble& s, const uint32_t* reversed, int i, float* x, float* y) {
  const uint32_t shuffled = reverseBits(laineKarras(reversed[i], s(0, i)));
  x[i] = unit(reverseBits(laineKarras(shuffled, s(1, i))));
  y[i] = unit(reverseBits(laineKarras(pascalDigits(shuffled), s(2, i))));
}

template <class Scramble>
GOBO_INLINE void points(const uint64_t* sequences, const uint32_t* reversed, uint32_t dimension, float* __restrict x, float* __restrict y) {
  const Scramble s(sequences, dimension);
  for (int i = 0; i < kLanes; ++i) point(s, reversed, i, x, y);
}

// Each point is a chain of multiplications that wait for each other; three chains side by side fill the time.
template <class Scramble>
GOBO_INLINE void threePoints(const uint64_t* sequences, const uint32_t* reversed, uint32_t dimension, float* __restrict out) {
  const Scramble a(sequences, dimension), b(sequences, dimension + 1), c(sequences, dimension + 2);
  for (int i = 0; i < kLanes; ++i) {
    point(a, reversed, i, out, out + kLanes);
    point(b, reversed, i, out + 2 * kLanes, out + 3 * kLanes);
    point(c, reversed, i, out + 4 * kLanes, out + 5 * kLanes);
  }
}

}  // namespace

GOBO_BY_PROCESSOR void sobolLanes1D(const uint64_t* sequences, bool one, const uint32_t* reversed, uint32_t dimension, float* __restrict out) {
  alignas(64) uint64_t hash[kLanes];
  if (one) {
    const uint64_t h = hash64(sequences[0], dimension);
    for (int i = 0; i < kLanes; ++i) hash[i] = h;
  } else {
    for (int i = 0; i < kLanes; ++i) hash[i] = hash64(sequences[i], dimension);
  }
  for (int i = 0; i < kLanes; ++i) out[i] = unit(reverseBits(laineKarras(reverseBits(laineKarras(reversed[i], uint32_t(hash[i] >> 32))), uint32_t(hash[i]))));
}

GOBO_BY_PROCESSOR void sobolLanes2D(const uint64_t* sequences, bool one, const uint32_t* reversed, uint32_t dimension, float* __restrict x,
                                    float* __restrict y) {
  if (one) points<OneScramble>(sequences, reversed, dimension, x, y);
  else points<LaneScrambles>(sequences, reversed, dimension, x, y);
}

GOBO_BY_PROCESSOR void sobolLanes3x2D(const uint64_t* sequences, bool one, const uint32_t* reversed, uint32_t dimension, float* __restrict out) {
  if (one) threePoints<OneScramble>(sequences, reversed, dimension, out);
  else threePoints<LaneScrambles>(sequences, reversed, dimension, out);
}

}  // namespace trace
}  // namespace gobo

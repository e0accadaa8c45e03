// SPDX-License-Identifier: Apache-2.0
#include "trace/view_samples.h"

#include "base/disk.h"
#include "base/sobol.h"

namespace gobo {
inline namespace trace {

Vec2 viewSamplePosition(int s, int S) {
  if (S <= 1) return Vec2(0.5f);
  constexpr uint32_t kSeedX = 0x6b79a3c1u, kSeedY = 0x2545f491u;
  return Vec2(toUnit(owenScramble(sobolBits(uint32_t(s), 0), kSeedX)), toUnit(owenScramble(sobolBits(uint32_t(s), 1), kSeedY)));
}

Vec2 viewSampleLens(int s, int S, uint64_t pixel) {
  constexpr uint64_t kSeed = 0x3c6ef372fe94f82bull;
  const uint64_t h = hash64(kSeed, pixel);
  const uint32_t at = S > 1 ? uint32_t(s) : 0u;
  return concentricDisk(Vec2(toUnit(owenScramble(sobolBits(at, 0), uint32_t(h >> 32))), toUnit(owenScramble(sobolBits(at, 1), uint32_t(h)))));
}

}  // namespace trace
}  // namespace gobo

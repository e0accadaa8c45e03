// SPDX-License-Identifier: Apache-2.0
#include "trace/view_samples.h"

#include "base/sobol.h"

namespace gobo {

Vec2 viewSamplePosition(int s, int S) {
  if (S <= 1) return Vec2(0.5f);
  constexpr uint32_t kSeedX = 0x6b79a3c1u, kSeedY = 0x2545f491u;
  return Vec2(toUnit(owenScramble(sobolBits(uint32_t(s), 0), kSeedX)), toUnit(owenScramble(sobolBits(uint32_t(s), 1), kSeedY)));
}

}  // namespace gobo

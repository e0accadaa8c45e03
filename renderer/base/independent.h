// SPDX-License-Identifier: Apache-2.0
// Independent uniform numbers by counters: plain Monte Carlo, whose error falls by the square root of the number of samples whatever is integrated.
#pragma once

#include "base/sobol.h"

namespace gobo {
inline namespace base {

/// Dimension `dimension` of sample `index`: a pure function of its arguments. [0,1) with 24 bits.
inline Vec2 independentPoint(uint64_t seed, uint32_t index, uint32_t dimension) {
  const uint64_t h = hash64(hash64(seed, index), dimension);
  return Vec2(toUnit(uint32_t(h >> 32)), toUnit(uint32_t(h)));
}

/// As SobolSampler: draws of one sample in turn.
class IndependentSampler {
 public:
  IndependentSampler(uint64_t seed, uint32_t index) : seed_(seed), index_(index) {}
  float next1D() { return next2D().x; }
  Vec2 next2D() { return independentPoint(seed_, index_, dimension_++); }

 private:
  uint64_t seed_;
  uint32_t index_, dimension_ = 0;
};

}  // namespace base
}  // namespace gobo

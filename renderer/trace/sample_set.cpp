// SPDX-License-Identifier: Apache-2.0
#include "trace/sample_set.h"

#include "base/halton.h"
#include "base/independent.h"

namespace gobo {
inline namespace trace {

void SampleSet::drawOther1D(uint32_t dimension, float* out) const {
  for (int i = 0; i < kLanes; ++i) {
    const uint32_t index = reverseBits(reversed_[i]);
    out[i] = kind_ == SamplerKind::Halton ? haltonValue(seed(i), index, dimension) : independentPoint(seed(i), index, dimension).x;
  }
}

void SampleSet::drawOther2D(uint32_t dimension, float* x, float* y) const {
  for (int i = 0; i < kLanes; ++i) {
    const uint32_t index = reverseBits(reversed_[i]);
    const Vec2 p = kind_ == SamplerKind::Halton ? haltonPoint(seed(i), index, dimension) : independentPoint(seed(i), index, dimension);
    x[i] = p.x;
    y[i] = p.y;
  }
}

}  // namespace trace
}  // namespace gobo

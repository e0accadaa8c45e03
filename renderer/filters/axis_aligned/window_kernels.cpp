// SPDX-License-Identifier: Apache-2.0
#include "filters/axis_aligned/window_kernels.h"

namespace gobo::axis_aligned {

void addToWindow(size_t n, const uint32_t* __restrict instance, const uint32_t* __restrict other, const float* __restrict narrow, const float* __restrict one,
                 const uint8_t* __restrict met, float* __restrict sumNarrow, float* __restrict sumOne, uint8_t* __restrict sumMet) {
  for (size_t x = 0; x < n; ++x) {
    const bool same = instance[x] == other[x];
    sumNarrow[x] += same ? narrow[x] : 0.0f;
    sumOne[x] += same ? one[x] : 0.0f;
  }
  for (size_t x = 0; x < n; ++x) sumMet[x] |= met[x];
}

}  // namespace gobo::axis_aligned

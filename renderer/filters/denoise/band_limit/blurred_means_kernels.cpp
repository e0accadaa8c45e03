// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/band_limit/blurred_means_kernels.h"

#include "filters/denoise/fast_exp.h"

namespace gobo::denoise {

void bandWeights(const float* __restrict at, const float* __restrict there, float square, float most, int n, float* __restrict w) {
  for (int t = 0; t < n; ++t) {
    const float narrower = at[t] > there[t] ? at[t] : there[t], x = square * narrower;
    const float e = fastExp(-x);
    w[t] = x <= most ? e : 0.0f;
  }
}

}  // namespace gobo::denoise

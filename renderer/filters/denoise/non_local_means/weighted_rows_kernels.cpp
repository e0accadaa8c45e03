// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/non_local_means/weighted_rows.h"

namespace gobo::denoise {

void multiplyRow(const float* __restrict by, int n, float* __restrict w) {
  for (int i = 0; i < n; ++i) w[i] *= by[i];
}
void addWeightedRow(const float* __restrict w, const float* __restrict in, int n, float* __restrict sum) {
  for (int i = 0; i < n; ++i) sum[i] += w[i] * in[i];
}
void addRow(const float* __restrict in, int n, float* __restrict sum) {
  for (int i = 0; i < n; ++i) sum[i] += in[i];
}

}  // namespace gobo::denoise

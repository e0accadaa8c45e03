// SPDX-License-Identifier: Apache-2.0
// Rows of numbers, vectorised.
#pragma once

namespace gobo::denoise {

void multiplyRow(const float* by, int n, float* w);                       ///< w *= by
void addWeightedRow(const float* w, const float* in, int n, float* sum);  ///< sum += w in
void addRow(const float* in, int n, float* sum);                          ///< sum += in

}  // namespace gobo::denoise

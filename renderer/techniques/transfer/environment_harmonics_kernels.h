// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

namespace gobo::transfer {

/// One row of an environment map against `orders` waves of `width` values each: adds sum over x of texel[3 x + c] wave[o width + x] to out[3 o + c].
/// In pieces of 64 in eight lanes of single precision, pieces in double: always in this order.
void addRow(const float* texel, size_t width, const float* wave, size_t orders, double* out);

}  // namespace gobo::transfer

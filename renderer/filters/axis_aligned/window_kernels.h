// SPDX-License-Identifier: Apache-2.0
// Rows of window sums over pixels of the same instance.
#pragma once

#include <cstddef>
#include <cstdint>

namespace gobo::axis_aligned {

/// For x in 0..n: of pixel x of one row and of another, `narrow`, `one` and what was `met` are added to pixel x's sums: the first two where both
/// are of the same instance.
void addToWindow(size_t n, const uint32_t* instance, const uint32_t* other, const float* narrow, const float* one, const uint8_t* met, float* sumNarrow,
                 float* sumOne, uint8_t* sumMet);

}  // namespace gobo::axis_aligned

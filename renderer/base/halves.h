// SPDX-License-Identifier: Apache-2.0
// 16-bit floats (IEEE 754 binary16) of pictures on their way out, rounded to nearest even. What is beyond their range is clamped: as infinity it would leave
// the picture. NaN stays NaN. Cost: some 0.3 ns a value. Pure; any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace gobo {
inline namespace base {

inline constexpr float kLargestHalf = 65504.0f;

/// Bits of `values` into `out`, which has room for as many. `infinite`: what is infinite stays so.
void toHalves(std::span<const float> values, uint16_t* out, bool infinite = false);

/// Finite values that toHalves clamps.
size_t beyondHalves(std::span<const float> values);

}  // namespace base
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// IEEE 754 binary16 by integers, for tables in memory: to the nearest, ties to even; beyond 65504 + 16 it is infinite, as the standard says. Exact the other
// way. Pure; any thread.
#pragma once

#include <bit>
#include <cstdint>

#include "base/halves.h"

namespace gobo::transfer {

inline uint16_t halfOf(float value) {
  const uint32_t bits = std::bit_cast<uint32_t>(value), sign = bits >> 16 & 0x8000u, size = bits & 0x7fffffffu;
  if (size >= 0x7f800000u) return uint16_t(sign | (size > 0x7f800000u ? 0x7e00u : 0x7c00u));  // NaN, infinite
  if (size >= 0x477ff000u) return uint16_t(sign | 0x7c00u);                                   // rounds beyond the largest
  if (size < 0x38800000u) {                                                                   // below 2^-14: a multiple of 2^-24
    // 2^23 + the number in units of 2^-24 rounds in the float's own last place.
    const float shifted = std::bit_cast<float>(size) * 0x1p24f + 0x1p23f;
    return uint16_t(sign | (std::bit_cast<uint32_t>(shifted) & 0x7ffu));
  }
  const uint32_t rounded = size + 0xfffu + (size >> 13 & 1u);
  return uint16_t(sign | ((rounded - 0x38000000u) >> 13));
}

inline float floatOf(uint16_t half) {
  const uint32_t sign = uint32_t(half & 0x8000u) << 16, size = half & 0x7fffu;
  if (size >= 0x7c00u) return std::bit_cast<float>(sign | 0x7f800000u | (size & 0x3ffu) << 13);
  if (size < 0x400u) return std::bit_cast<float>(sign | std::bit_cast<uint32_t>(float(size) * 0x1p-24f));
  return std::bit_cast<float>(sign | ((size << 13) + 0x38000000u));
}

}  // namespace gobo::transfer

// SPDX-License-Identifier: Apache-2.0
// 16-bit floats, against Imath's one by one.
#include "base/halves.h"

#include <gtest/gtest.h>

#include <Imath/half.h>

#include <bit>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

namespace gobo {
namespace {

uint16_t expected(float v, bool infinite) {
  if (infinite && std::isinf(v)) return Imath::half(v).bits();
  return Imath::half(v > kLargestHalf ? kLargestHalf : v < -kLargestHalf ? -kLargestHalf : v).bits();
}

TEST(Halves, AreImathsAndClampedForAnyNumber) {
  std::vector<float> values;
  for (uint32_t bits = 0; bits < 0x10000; ++bits) {  // every half, the middle to the next one and what is beside that
    const float v = imath_half_to_float(uint16_t(bits)), next = imath_half_to_float(uint16_t(bits + 1)), middle = 0.5f * (v + next);
    for (const float x : {v, middle, std::nextafter(middle, -HUGE_VALF), std::nextafter(middle, HUGE_VALF)}) values.push_back(x);
  }
  std::mt19937 random(5);
  for (int k = 0; k < 100000; ++k) values.push_back(std::bit_cast<float>(uint32_t(random())));
  for (const float x : {65519.9f, 65520.0f, 1e30f, -1e30f, HUGE_VALF, -HUGE_VALF, 0.0f, -0.0f, std::numeric_limits<float>::denorm_min()}) values.push_back(x);
  std::vector<uint16_t> halves(values.size());
  for (const bool infinite : {false, true}) {
    toHalves(values, halves.data(), infinite);
    for (size_t k = 0; k < values.size(); ++k) {
      if (std::isnan(values[k])) ASSERT_TRUE((halves[k] & 0x7c00) == 0x7c00 && (halves[k] & 0x3ff) != 0) << std::bit_cast<uint32_t>(values[k]);
      else ASSERT_EQ(halves[k], expected(values[k], infinite)) << values[k] << (infinite ? " infinite" : "");
    }
  }
}

TEST(Halves, OfAnyCountAndNotOneMore) {
  for (size_t n = 0; n < 40; ++n) {
    std::vector<float> values(n);
    for (size_t k = 0; k < n; ++k) values[k] = 0.1f + 3.7f * float(k);
    std::vector<uint16_t> halves(n + 3, 0xabcd);
    toHalves(values, halves.data());
    for (size_t k = 0; k < n; ++k) EXPECT_EQ(halves[k], expected(values[k], false)) << k << " of " << n;
    for (size_t k = n; k < n + 3; ++k) EXPECT_EQ(halves[k], 0xabcd) << n;
  }
}

TEST(Halves, WhatIsClampedIsCounted) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(beyondHalves({}), 0u);
  EXPECT_EQ(beyondHalves(std::vector<float>{65504.0f, -65504.0f, 0.0f, nan, HUGE_VALF, -HUGE_VALF}), 0u);
  EXPECT_EQ(beyondHalves(std::vector<float>{65504.1f, 1.0f, -65505.0f, 3e38f, nan, HUGE_VALF, 65504.0f, 2.0f, -1e10f}), 4u);
}

}  // namespace
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "base/to_index.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace gobo::to_index_test {
namespace {

template <typename F>
void clampsEverything() {
  constexpr F inf = std::numeric_limits<F>::infinity(), most = std::numeric_limits<F>::max();
  const F nan = std::numeric_limits<F>::quiet_NaN();
  constexpr int top = std::numeric_limits<int>::max(), bottom = std::numeric_limits<int>::min();
  for (const int n : {1, 2, 12, 1 << 24, (1 << 24) + 1, top}) {
    EXPECT_EQ(toIndex(nan, n), 0);
    EXPECT_EQ(toIndex(-nan, n), 0);
    for (const F low : {-inf, -most, F(-1), F(-0.0), F(0), std::numeric_limits<F>::denorm_min(), F(0.75)}) EXPECT_EQ(toIndex(low, n), 0) << low;
    for (const F high : {inf, most, F(n), F(3e9)}) EXPECT_EQ(toIndex(high, n), n - 1) << high;
  }
  EXPECT_EQ(toIndex(F(3.999), 12), 3);
  EXPECT_EQ(toInteger(nan, -5, 5), -5);
  EXPECT_EQ(toInteger(F(-3.7), -5, 5), -3);  // towards zero, as the plain conversion
  EXPECT_EQ(toInteger(inf, bottom, top), top);
  EXPECT_EQ(toInteger(-inf, bottom, top), bottom);
  EXPECT_EQ(toInteger(F(2147483648.0), bottom, top), top);
  EXPECT_EQ(toInteger(F(-2147483648.0), bottom, top), bottom);
}

TEST(ToIndex, ClampsWhatDoesNotFit) {
  clampsEverything<float>();
  clampsEverything<double>();
}

}  // namespace
}  // namespace gobo::to_index_test

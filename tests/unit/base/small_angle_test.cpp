// SPDX-License-Identifier: Apache-2.0
#include "base/small_angle.h"

#include <gtest/gtest.h>

#include <limits>

namespace gobo {
namespace {

TEST(SmallAngle, IsTheSineAndCosine) {
  for (int i = -4000; i <= 4000; ++i) {
    const double x = i * 5e-5;  // 0.2: the library beyond kMost
    const SmallAngle angle(x);
    EXPECT_NEAR(angle.sine, double(sinl(x)), 2.3e-16 * std::fabs(x)) << x;
    EXPECT_NEAR(angle.cosine, double(cosl(x)), 2.5e-16) << x;
  }
  const double edge = std::nextafter(SmallAngle::kMost, 0.0);
  EXPECT_NEAR(SmallAngle(edge).sine, std::sin(edge), 3e-17);
  EXPECT_EQ(SmallAngle(1e6).sine, std::sin(1e6));
  EXPECT_EQ(SmallAngle(0.0).cosine, 1.0);
  EXPECT_TRUE(std::isnan(SmallAngle(std::numeric_limits<double>::quiet_NaN()).sine));
  EXPECT_TRUE(std::isnan(SmallAngle(std::numeric_limits<double>::infinity()).cosine));
}

}  // namespace
}  // namespace gobo

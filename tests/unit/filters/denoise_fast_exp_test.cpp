// SPDX-License-Identifier: Apache-2.0
// fastExp and fastLog against the library in double.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "filters/denoise/fast_exp.h"

namespace {

using gobo::denoise::fastExp;
using gobo::denoise::fastLog;

TEST(DenoiseFastExp, IsWithinTheErrorThatItsHeaderStates) {
  double worst = 0;
  for (int i = 0; i <= 4'000'000; ++i) {
    const float x = -87.0f * float(i) / 4'000'000.0f;
    if (x <= -87.0f) continue;
    worst = std::max(worst, std::fabs(double(fastExp(x)) / std::exp(double(x)) - 1));
  }
  for (float x = -1.0f; x < -1e-38f; x *= 0.99f) worst = std::max(worst, std::fabs(double(fastExp(x)) / std::exp(double(x)) - 1));
  EXPECT_LT(worst, 2e-7);
  std::cout << "fastExp: worst relative error " << worst << std::endl;
}

TEST(DenoiseFastExp, EndsAreExact) {
  EXPECT_EQ(fastExp(0.0f), 1.0f);
  EXPECT_EQ(fastExp(-0.0f), 1.0f);
  EXPECT_EQ(fastExp(-1e-30f), 1.0f);
  EXPECT_GT(fastExp(-86.99f), 1.2e-38f);
  for (float x : {-87.01f, -88.0f, -1000.0f, -3e38f, -std::numeric_limits<float>::infinity(), std::numeric_limits<float>::quiet_NaN()})
    EXPECT_EQ(fastExp(x), 0.0f) << x;
}

TEST(DenoiseFastExp, NeverGrowsAsItsArgumentFalls) {
  float before = 1;
  for (float x = 0; x > -90; x -= 1.0f / 1024) {
    const float e = fastExp(x);
    ASSERT_LE(e, before) << x;
    before = e;
  }
}

TEST(DenoiseFastLog, IsWithinTheErrorThatItsHeaderStates) {
  EXPECT_EQ(fastLog(1.0f), 0.0f);
  double worst = 0;
  for (float x = 1.2e-38f; x < 3e38f; x *= 1.0001f) {
    const double truth = std::log(double(x));
    worst = std::max(worst, std::fabs(fastLog(x) - truth) / std::max(std::fabs(truth), 1.0));
  }
  for (float d = 1e-7f; d < 0.5f; d *= 1.001f)
    for (float x : {1 - d, 1 + d}) worst = std::max(worst, std::fabs(fastLog(x) - std::log(double(x))));
  EXPECT_LT(worst, 2e-7);
  std::cout << "fastLog: worst error " << worst << std::endl;
}

}  // namespace

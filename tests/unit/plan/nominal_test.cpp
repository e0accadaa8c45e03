// SPDX-License-Identifier: Apache-2.0
// The power that an added light is traced with: near its intensity, so that sampling knows its order, and the same for small edits.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "request/effective_scene.h"

namespace gobo {
namespace {

TEST(NominalBucket, IsAPowerOfSixteenWithinAFactorOfFour) {
  for (float x = 1e-30f; x < 1e30f; x *= 1.7f) {
    const float n = nominalBucket(x);
    EXPECT_LE(std::max(n / x, x / n), 4.001f) << x;
    const double exponent = std::log2(double(n)) / 4;
    EXPECT_EQ(exponent, std::round(exponent)) << x;
  }
  EXPECT_EQ(nominalBucket(16.0f), 16.0f);
  EXPECT_EQ(nominalBucket(0.9f), nominalBucket(1.2f));
  for (const float odd : {0.0f, -1.0f, std::numeric_limits<float>::infinity(), std::numeric_limits<float>::quiet_NaN()}) EXPECT_EQ(nominalBucket(odd), 1.0f);
}

}  // namespace
}  // namespace gobo

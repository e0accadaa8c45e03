// SPDX-License-Identifier: Apache-2.0
#include "server/encode_pace.h"

#include <gtest/gtest.h>

#include <limits>

namespace gobo::encode_pace_test {
namespace {

TEST(EncodePace, LearnsEachFormatForItself) {
  EncodePace pace;
  EXPECT_EQ(pace.expectedMs(v1::Encoding::JPEG, 1 << 20), 0) << "nothing is known";
  pace.took(v1::Encoding::JPEG, 10000, 10);
  EXPECT_DOUBLE_EQ(pace.expectedMs(v1::Encoding::JPEG, 20000), 20);
  EXPECT_EQ(pace.expectedMs(v1::Encoding::PNG, 20000), 0);
  for (int i = 0; i < 60; ++i) pace.took(v1::Encoding::JPEG, 10000, 30);
  EXPECT_NEAR(pace.expectedMs(v1::Encoding::JPEG, 10000), 30, 1e-3);
}

TEST(EncodePace, WhatSaysNothingIsLeftOut) {
  EncodePace pace;
  pace.took(v1::Encoding::JPEG, 0, 1);
  pace.took(v1::Encoding::JPEG, 100, 50);  // a small one: the call, not its pixels
  pace.took(v1::Encoding::JPEG, 10000, std::numeric_limits<double>::quiet_NaN());
  pace.took(v1::Encoding::Format(1000), 10000, 1);
  EXPECT_EQ(pace.expectedMs(v1::Encoding::JPEG, 10000), 0);
  EXPECT_EQ(pace.expectedMs(v1::Encoding::Format(1000), 10000), 0);
}

}  // namespace
}  // namespace gobo::encode_pace_test

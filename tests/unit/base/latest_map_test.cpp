// SPDX-License-Identifier: Apache-2.0
#include "base/latest_map.h"

#include <gtest/gtest.h>

#include <string>

namespace gobo::testing {
namespace {

TEST(LatestMap, WhatWasTouchedLongestAgoGoes) {
  LatestMap<std::string, int> map(2);
  map.touch("a") = 1;
  map.touch("b") = 2;
  EXPECT_EQ(map.touch("a"), 1);
  map.touch("c") = 3;
  EXPECT_EQ(map.find("b"), nullptr);
  ASSERT_TRUE(map.find("a") && map.find("c"));
  EXPECT_EQ(*map.find("a"), 1);
  EXPECT_EQ(*map.find("c"), 3);
}

TEST(LatestMap, FindingTouchesNothing) {
  LatestMap<int, int> map(2);
  map.touch(1) = 10;
  map.touch(2) = 20;
  ASSERT_TRUE(map.find(1));
  map.touch(3);
  EXPECT_EQ(map.find(1), nullptr);
  EXPECT_EQ(*map.find(2), 20);
}

}  // namespace
}  // namespace gobo::testing

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

TEST(LatestMap, WhatWasTakenIsForgotten) {
  LatestMap<int, int> map(2);
  map.touch(1) = 10;
  map.touch(2) = 20;
  EXPECT_EQ(map.take(1), 10);
  EXPECT_EQ(map.take(1), 0);
  EXPECT_EQ(map.find(1), nullptr);
  map.touch(3) = 30;  // there is room again
  EXPECT_TRUE(map.find(2));
  map.clear();
  EXPECT_FALSE(map.find(2) || map.find(3));
  map.touch(4) = 40;
  map.touch(5) = 50;
  EXPECT_TRUE(map.find(4));
}

}  // namespace
}  // namespace gobo::testing

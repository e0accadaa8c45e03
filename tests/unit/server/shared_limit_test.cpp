// SPDX-License-Identifier: Apache-2.0
// SharedLimit: no sequence of takes and releases passes the limit or a client's part of it, but for the two stated exceptions.
#include "server/shared_limit.h"

#include <gtest/gtest.h>

#include <random>
#include <thread>
#include <vector>

namespace gobo::shared_limit_test {
namespace {

TEST(SharedLimit, OneClientLeavesRoomForTheNext) {
  SharedLimit limit(8);
  std::vector<std::unique_ptr<SharedLimit::Hold>> holds;
  while (auto hold = limit.take("greedy", 1)) holds.push_back(std::move(hold));
  EXPECT_EQ(limit.usedBy("greedy"), 4u);
  EXPECT_NE(limit.take("other", 4), nullptr);
  EXPECT_EQ(limit.usedBy("other"), 0u);
  holds.clear();
  EXPECT_EQ(limit.used(), 0u);
}

TEST(SharedLimit, HoldsOfNothingComeAndGo) {
  SharedLimit limit(8);
  auto first = limit.take("a", 0), second = limit.take("a", 0), some = limit.take("a", 2);
  ASSERT_TRUE(first && second && some);
  some.reset();
  first.reset();
  second.reset();
  EXPECT_EQ(limit.used(), 0u);
  EXPECT_TRUE(limit.clients().empty());
  EXPECT_TRUE(limit.take("a", 1));
}

TEST(SharedLimit, WhatIsLargerThanTheBoundGoesAlone) {
  SharedLimit limit(100);
  const auto huge = limit.take("a", 1000);
  ASSERT_NE(huge, nullptr);
  EXPECT_EQ(limit.take("b", 1), nullptr);
  EXPECT_EQ(limit.take("a", 1), nullptr);
}

TEST(SharedLimit, AFirstHoldMayPassThePartButNotTheLimit) {
  SharedLimit limit(100);
  const auto small = limit.take("a", 10);
  EXPECT_NE(limit.take("b", 80), nullptr);
  EXPECT_EQ(limit.take("b", 91), nullptr);
}

TEST(SharedLimit, RandomTakesStayWithinBothBounds) {
  std::mt19937 random(7);
  for (int round = 0; round < 200; ++round) {
    const uint64_t bound = 1 + random() % 1000;
    SharedLimit limit(bound);
    struct Held {
      std::string client;
      uint64_t amount;
      std::unique_ptr<SharedLimit::Hold> hold;
    };
    std::vector<Held> held;
    for (int i = 0; i < 300; ++i) {
      if (random() % 3 == 0 && !held.empty()) {
        held.erase(held.begin() + long(random() % held.size()));
      } else {
        const std::string client(1, char('a' + random() % 4));
        const uint64_t amount = 1 + random() % (bound + bound / 4 + 1), before = limit.used();
        if (auto hold = limit.take(client, amount)) {
          EXPECT_TRUE(limit.used() <= bound || before == 0);
          EXPECT_TRUE(limit.usedBy(client) <= std::max<uint64_t>(1, bound / 2) || limit.usedBy(client) == amount);
          held.push_back({client, amount, std::move(hold)});
        }
      }
      uint64_t sum = 0;
      for (const Held& h : held) sum += h.amount;
      ASSERT_EQ(limit.used(), sum);
    }
  }
}

}  // namespace
}  // namespace gobo::shared_limit_test

// SPDX-License-Identifier: Apache-2.0
#include "base/right_of_way.h"

#include <gtest/gtest.h>

#include <atomic>
#include <optional>
#include <thread>

#include "base/task_arena.h"

namespace gobo::right_of_way_test {
namespace {

using Clock = RightOfWay::Clock;
using namespace std::chrono_literals;
constexpr auto kLong = 60s;  // of a test that fails

TEST(RightOfWay, NobodyWaitsWhereNobodyHasIt) {
  RightOfWay way(kLong);
  way.stepAside({});
  { const RightOfWay::Taken taken(&way); }
  way.stepAside({});
  EXPECT_EQ(way.credit(), Clock::duration(kLong));
}

TEST(RightOfWay, PiecesBeginOnceItIsGivenBack) {
  RightOfWay way(kLong);
  const TaskArena shared(2, TaskArena::Threads::Shared, &way);
  std::optional<RightOfWay::Taken> taken(std::in_place, &way);
  std::atomic<bool> given{false}, early{false};
  std::thread big([&] {
    shared.parallelFor(64, 1, [&](size_t, size_t) {
      if (!given.load()) early = true;
    });
  });
  std::this_thread::sleep_for(50ms);
  given = true;
  taken.reset();
  big.join();
  EXPECT_FALSE(early.load());
  EXPECT_LT(way.credit(), Clock::duration(kLong)) << "the wait was counted";
}

TEST(RightOfWay, WorkOnAnArenaOfItsOwnHasIt) {
  RightOfWay way(kLong);
  const TaskArena shared(2, TaskArena::Threads::Shared, &way), own(2, TaskArena::Threads::Own, &way);
  std::atomic<bool> over{false}, early{false};
  std::thread big;
  own.parallelFor(1, 1, [&](size_t, size_t) {
    big = std::thread([&] {
      shared.parallelFor(8, 1, [&](size_t, size_t) {
        if (!over.load()) early = true;
      });
    });
    std::this_thread::sleep_for(50ms);
    over = true;
  });
  big.join();
  EXPECT_FALSE(early.load());
  own.execute([&] {
    over = false;
    big = std::thread([&] { shared.parallelFor(8, 1, [&](size_t, size_t) { early = early || !over.load(); }); });
    std::this_thread::sleep_for(50ms);
    over = true;
  });
  big.join();
  EXPECT_FALSE(early.load());
}

TEST(RightOfWay, WhatNeverEndsIsNotWaitedFor) {
  RightOfWay way(20ms);
  const RightOfWay::Taken taken(&way);
  const TaskArena shared(2, TaskArena::Threads::Shared, &way);
  std::atomic<int> done{0};
  EXPECT_TRUE(shared.parallelFor(16, 1, [&](size_t, size_t) { ++done; }));  // would hang
  EXPECT_EQ(done.load(), 16);
}

TEST(RightOfWay, AStopEndsTheWait) {
  RightOfWay way(kLong);
  const RightOfWay::Taken taken(&way);
  const TaskArena shared(2, TaskArena::Threads::Shared, &way);
  StopSource stop;
  std::thread later([&] {
    std::this_thread::sleep_for(30ms);
    stop.stop(StopReason::Cancelled);
  });
  const auto begun = Clock::now();
  EXPECT_FALSE(shared.parallelFor(
      16, 1, [&](size_t, size_t) { ADD_FAILURE() << "a piece began"; }, stop.token()));
  EXPECT_LT(Clock::now() - begun, kLong / 2);
  later.join();
}

TEST(RightOfWay, CreditComesBackWithTimeThatNobodyWaits) {
  RightOfWay way(10ms);
  {
    const RightOfWay::Taken taken(&way);
    way.stepAside({});  // all of it
    EXPECT_LT(way.credit(), Clock::duration(10ms));
  }
  std::this_thread::sleep_for(30ms);
  EXPECT_EQ(way.credit(), Clock::duration(10ms));
}

}  // namespace
}  // namespace gobo::right_of_way_test

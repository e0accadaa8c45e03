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

TEST(RightOfWay, WaitsAreCountedAndCreditComesBackWithTime) {
  RightOfWay way(kLong);
  std::optional<RightOfWay::Taken> taken(std::in_place, &way);
  StopSource stop;
  std::thread big([&] { way.stepAside(stop.token()); });
  const auto until = Clock::now() + kLong;
  while (way.credit() > Clock::duration(kLong) - 100ms && Clock::now() < until) std::this_thread::sleep_for(1ms);  // it falls for as long as somebody waits
  EXPECT_LT(way.credit(), Clock::duration(kLong));
  taken.reset();
  big.join();
  while (way.credit() < Clock::duration(kLong) && Clock::now() < until) std::this_thread::sleep_for(1ms);
  EXPECT_EQ(way.credit(), Clock::duration(kLong)) << "and grows again, up to what it was";
}

}  // namespace
}  // namespace gobo::right_of_way_test

// SPDX-License-Identifier: Apache-2.0
#include "plan/work_in_flight.h"

#include <gtest/gtest.h>

#include <atomic>
#include <functional>
#include <optional>
#include <random>
#include <thread>

namespace gobo {
namespace {

TermPtr term(int width) { return std::make_shared<Term>("test", Domain::List, Extent{width, 1, 1}); }
constexpr Hash128 kA{1, 1}, kB{2, 2};

TEST(WorkInFlight, OneMakesItAndAllWhoWaitGetIt) {
  WorkInFlight work;
  auto first = work.take(kA, 0, {});
  ASSERT_TRUE(first.ok());
  EXPECT_FALSE(first->result());
  EXPECT_FALSE(first->wanted());
  std::atomic<int> got{0};
  const TermPtr made = term(3);
  std::vector<std::thread> others;
  for (int i = 0; i < 4; ++i)
    others.emplace_back([&] {
      const auto turn = work.take(kA, 0, {});
      if (turn.ok() && turn->result() == made) ++got;
    });
  while (!first->wanted()) std::this_thread::yield();
  ASSERT_TRUE(work.take(kB, 0, {}).ok()) << "another recipe does not wait";
  const uint64_t before = work.ended();
  first->finish(made);
  { const auto over = std::move(*first); }
  for (auto& t : others) t.join();
  EXPECT_GT(work.ended(), before);
  // Those who came to wait got it; who came later starts anew and is the store's to serve.
  EXPECT_GE(got, 1);
  EXPECT_EQ(work.shared(), uint64_t(got));
}

TEST(WorkInFlight, FewerBlocksAreWaitedForAndMoreAreNot) {
  WorkInFlight work;
  auto many = work.take(kA, 64, {});
  ASSERT_TRUE(many.ok());
  auto few = work.take(kA, 4, {});  // does not wait for 64
  ASSERT_TRUE(few.ok());
  EXPECT_FALSE(few->result());
  std::atomic<bool> in{false};
  std::thread third([&] {
    const auto turn = work.take(kA, 16, {});
    EXPECT_TRUE(turn.ok());
    EXPECT_FALSE(turn->result()) << "4 blocks are not 16";
    in = true;
  });
  while (!few->wanted()) std::this_thread::yield();
  EXPECT_FALSE(in);
  EXPECT_FALSE(many->wanted());
  few->finish(term(1));
  { const auto over = std::move(*few); }
  third.join();
}

TEST(WorkInFlight, WhoFailsLeavesItToTheNextAndAStopEndsTheWait) {
  WorkInFlight work;
  std::optional<Result<WorkInFlight::Turn>> first{work.take(kA, 0, {})};
  StopSource source;
  std::thread stopped([&] { EXPECT_EQ(work.take(kA, 0, source.token()).status().code(), Code::Cancelled); });
  while (!(*first)->wanted()) std::this_thread::yield();
  source.stop(StopReason::Cancelled);
  stopped.join();
  EXPECT_FALSE((*first)->wanted());
  std::thread next([&] {
    const auto turn = work.take(kA, 0, {});
    EXPECT_TRUE(turn.ok() && !turn->result());
  });
  while (!(*first)->wanted()) std::this_thread::yield();
  first.reset();
  next.join();
}

// Any number of threads, recipes that are made of one another: never two at one recipe, everything ends.
TEST(WorkInFlight, NeverTwoAtOnceAndNeverACircle) {
  WorkInFlight work;
  constexpr int kRecipes = 6;
  std::atomic<int> at[kRecipes] = {};
  std::atomic<int> made{0};
  const std::function<void(int, std::mt19937&)> make = [&](int recipe, std::mt19937& random) {
    const auto turn = work.take({uint64_t(recipe), 7}, 0, {});
    ASSERT_TRUE(turn.ok());
    if (turn->result()) return;
    EXPECT_EQ(at[recipe].fetch_add(1), 0);
    if (recipe > 0) make(int(random() % uint32_t(recipe)), random);  // what it is made of, as a fold does
    std::this_thread::yield();
    EXPECT_EQ(at[recipe].fetch_sub(1), 1);
    ++made;
    if (random() % 4) const_cast<WorkInFlight::Turn&>(*turn).finish(term(recipe + 1));
  };
  std::vector<std::thread> threads;
  for (unsigned t = 0; t < 6; ++t)
    threads.emplace_back([&, t] {
      std::mt19937 random(t);
      for (int i = 0; i < 300; ++i) make(int(random() % kRecipes), random);
    });
  for (auto& t : threads) t.join();
  EXPECT_GT(made, 0);
  EXPECT_GT(work.shared(), 0u);
}

}  // namespace
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "base/task_arena.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <thread>

namespace gobo::task_arena_test {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::chrono::seconds kLong{20};  // a bound on a test that fails

/// Waits for `count` threads at once; false: they never were.
bool meet(std::atomic<size_t>& here, size_t count) {
  const auto end = Clock::now() + kLong;
  for (++here; here.load() < count; std::this_thread::yield())
    if (Clock::now() > end) return false;
  return true;
}

TEST(TaskArena, ThreadsOfItsOwnRunWhileAnotherArenaHasAllOthers) {
  const TaskArena all, own(2, TaskArena::Threads::Own);
  std::atomic<size_t> busy{0}, met{0};
  std::atomic<bool> over{false}, together{true};
  std::thread big([&] {
    all.parallelFor(size_t(all.threads()), 1, [&](size_t, size_t) {
      ++busy;
      while (!over.load()) std::this_thread::yield();
    });
  });
  const auto end = Clock::now() + kLong;
  while (busy.load() < size_t(all.threads()) && Clock::now() < end) std::this_thread::yield();
  EXPECT_EQ(busy.load(), size_t(all.threads()));
  // Two pieces that end only when both run: the second one needs a thread beside the caller's.
  EXPECT_TRUE(own.parallelFor(2, 1, [&](size_t, size_t) {
    if (!meet(met, 2)) together = false;
  }));
  EXPECT_TRUE(together.load());
  over = true;
  big.join();
}

}  // namespace
}  // namespace gobo::task_arena_test

// SPDX-License-Identifier: Apache-2.0
#include "server/freed_memory.h"

#include <gtest/gtest.h>
#include <stdlib.h>
#include <string.h>

#include <array>
#include <latch>
#include <thread>
#include <vector>

#include "server/server_metrics.h"
#include "support/instrumented.h"

namespace gobo::freed_memory_test {
namespace {

constexpr size_t kMiB = 1 << 20;

/// As messages leave it: blocks of many MiB in the arenas of several threads, freed below something small that stays.
struct Leftovers {
  std::array<std::vector<void*>, 4> small;
  Leftovers() {
    void* volatile first = malloc(24 * kMiB);  // volatile: or it is optimised away
    free(first);                               // from here on malloc keeps blocks up to this size
    std::latch all(int(small.size()));         // an arena whose thread has ended is the next one's
    std::vector<std::thread> threads;
    for (std::vector<void*>& stays : small)
      threads.emplace_back([&] {
        std::vector<void*> large;
        for (int i = 0; i < 6; ++i) {
          large.push_back(malloc(16 * kMiB));
          memset(large.back(), 1, 16 * kMiB);
          stays.push_back(malloc(64));
        }
        all.arrive_and_wait();
        for (void* p : large) free(p);
      });
    for (std::thread& t : threads) t.join();
  }
  ~Leftovers() {
    for (std::vector<void*>& stays : small)
      for (void* p : stays) free(p);
  }
};

TEST(FreedMemory, WhatMallocKeepsBeyondItsPartGoes) {
  if (gobo::testing::kInstrumented) GTEST_SKIP() << "a sanitizer has its own malloc";
  FreedMemory none(0);
  none.look();
  FreedMemory some(64 * kMiB), much(4096 * kMiB);
  const uint64_t before = residentBytes();
  const Leftovers leftovers;
  ASSERT_GT(residentBytes(), before + 128 * kMiB) << "malloc has kept nothing";
  EXPECT_EQ(much.look(), 0u);
  EXPECT_GT(some.look(), 96 * kMiB);
  EXPECT_LT(residentBytes(), before + 64 * kMiB);
  EXPECT_EQ(some.look(), 0u) << "not again before there is something";
}

TEST(FreedMemory, EachSecondByItself) {
  if (gobo::testing::kInstrumented) GTEST_SKIP() << "a sanitizer has its own malloc";
  FreedMemory some(64 * kMiB);
  const uint64_t before = residentBytes();
  const Leftovers leftovers;
  ASSERT_GT(residentBytes(), before + 128 * kMiB) << "malloc has kept nothing";
  some.start();
  for (int i = 0; i < 400 && residentBytes() >= before + 64 * kMiB; ++i) std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_LT(residentBytes(), before + 64 * kMiB);
}

TEST(FreedMemory, ItsPartIsOfTheTotal) {
  EXPECT_EQ(FreedMemory::keepOf(0), 64 * kMiB);
  EXPECT_EQ(FreedMemory::keepOf(3072 * kMiB), 192 * kMiB);
  EXPECT_EQ(FreedMemory::keepOf(UINT64_MAX), 1024 * kMiB);
}

}  // namespace
}  // namespace gobo::freed_memory_test

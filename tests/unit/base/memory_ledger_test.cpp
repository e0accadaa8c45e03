// SPDX-License-Identifier: Apache-2.0
#include "base/memory_ledger.h"

#include <gtest/gtest.h>

#include <atomic>
#include <random>
#include <thread>

namespace gobo::memory_ledger_test {
namespace {

/// Holds `bytes`, of which `pinned` are in use.
struct Cache {
  std::mutex mutex;
  uint64_t bytes = 0, pinned = 0;
  int shrunk = 0;
  std::shared_ptr<const MemoryHolder> account;
  Cache(MemoryLedger& ledger, const std::string& name, uint64_t has, bool gives = true) : bytes(has) {
    MemoryHolder h{name, [] { return UINT64_MAX; },
                   [this] {
                     const std::lock_guard lock(mutex);
                     return bytes;
                   }};
    if (gives)
      h.shrink = [this](uint64_t most) {
        const std::lock_guard lock(mutex);
        ++shrunk;
        bytes = std::min(bytes, std::max(most, pinned));
      };
    account = ledger.add(std::move(h));
  }
};

TEST(MemoryLedger, ThoseThatCameFirstGiveFirstAndNoMoreThanIsNeeded) {
  MemoryLedger ledger(100);
  Cache a(ledger, "a", 30), fixed(ledger, "fixed", 20, false), b(ledger, "b", 40);
  EXPECT_EQ(ledger.held(), 90u);
  EXPECT_TRUE(ledger.makeRoom(10, "x").ok());
  EXPECT_EQ(a.shrunk + b.shrunk, 0);
  EXPECT_TRUE(ledger.makeRoom(25, "x").ok());
  EXPECT_EQ(a.bytes, 15u);
  EXPECT_EQ(b.bytes, 40u);
  EXPECT_TRUE(ledger.makeRoom(60, "x").ok());
  EXPECT_EQ(a.bytes, 0u);
  EXPECT_EQ(b.bytes, 20u);
  EXPECT_EQ(fixed.bytes, 20u);
  b.bytes = 300;  // grew by itself
  ledger.settle();
  EXPECT_EQ(ledger.held(), 100u);
}

// Who gives back while sums are made leaves no sum below the total from which the total is taken.
TEST(MemoryLedger, WhatIsGivenBackMeanwhileEmptiesNobody) {
  for (int until = 1; until < 8; ++until) {
    MemoryLedger ledger(100);
    int asked = 0;
    uint64_t least = UINT64_MAX;
    const auto held = ledger.add(
        {"cache", [] { return UINT64_MAX; }, [&] { return uint64_t(++asked <= until ? 110 : 90); }, [&](uint64_t most) { least = std::min(least, most); }});
    EXPECT_TRUE(ledger.makeRoom(0, "nothing").ok()) << until;
    EXPECT_GE(least, 80u) << until;
  }
}

TEST(MemoryLedger, WhatDoesNotFitIsRefusedAndSaysWhatHolds) {
  MemoryLedger ledger(100);
  Cache a(ledger, "cache", 30), fixed(ledger, "renders", 50, false);
  a.pinned = 20;
  const Status s = ledger.makeRoom(40, "a scene");
  EXPECT_EQ(s.code(), Code::ResourceExhausted);
  for (const char* words : {"a scene of 40 bytes", "renders 50", "cache 20", "at most 100", "engine.memory_bytes"})
    EXPECT_NE(s.message().find(words), std::string::npos) << s.message();
  EXPECT_EQ(ledger.makeRoom(UINT64_MAX, "x").code(), Code::ResourceExhausted);  // the sum does not wrap
  EXPECT_TRUE(MemoryLedger().makeRoom(UINT64_MAX, "x").ok());                   // no total: anything
}

TEST(MemoryLedger, WhoHasGoneIsNotAsked) {
  MemoryLedger ledger(10);
  {
    Cache gone(ledger, "gone", 1000, false);
    EXPECT_FALSE(ledger.makeRoom(1, "x").ok());
  }
  EXPECT_EQ(ledger.held(), 0u);
  EXPECT_TRUE(ledger.holders().empty());
}

TEST(MemoryLedger, StaysWithinTheTotalWhileManyGrow) {
  MemoryLedger ledger(1000);
  Cache a(ledger, "a", 0), b(ledger, "b", 0);
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      std::mt19937 random(unsigned(t) + 7);
      for (int i = 0; i < 2000; ++i) {
        Cache& mine = random() % 2 ? a : b;
        EXPECT_TRUE(ledger.makeRoom(50, "x").ok());
        const std::lock_guard lock(mine.mutex);
        mine.bytes += random() % 50;
      }
    });
  for (auto& t : threads) t.join();
  EXPECT_LE(ledger.held(), 1000u + 4 * 50);  // each may have grown since it asked
  ledger.settle();
  EXPECT_LE(ledger.held(), 1000u);
}

}  // namespace
}  // namespace gobo::memory_ledger_test

// SPDX-License-Identifier: Apache-2.0
// TermStore: the bound, the order of eviction, the tiers, and many threads at once.
#include "plan/store.h"

#include <gtest/gtest.h>

#include <atomic>
#include <filesystem>
#include <thread>

#include "plan/disk_store.h"
#include "unit/plan/term_maker.h"

namespace gobo {
namespace {

using test::key;
using test::makeTerm;
using test::TempFolder;

TEST(TermStore, LeastRecentlyUsedLeavesFirstAndBytesStayWithinTheBound) {
  const uint64_t one = makeTerm(0, 1000)->bytes();
  TermStore store(3 * one);
  for (int i = 0; i < 3; ++i) store.put(key(i), makeTerm(i, 1000), false);
  EXPECT_EQ(store.bytes(), 3 * one);
  EXPECT_NE(store.get(key(0)), nullptr);  // 1 is now the oldest
  store.put(key(3), makeTerm(3, 1000), false);
  EXPECT_EQ(store.get(key(1)), nullptr);
  EXPECT_NE(store.get(key(0)), nullptr);
  EXPECT_NE(store.get(key(2)), nullptr);
  EXPECT_NE(store.get(key(3)), nullptr);
  EXPECT_EQ(store.bytes(), 3 * one);
  EXPECT_EQ(store.count(), 3u);
  const uint64_t big = makeTerm(4, 1500)->bytes();  // needs two to leave: 0 and 2
  ASSERT_GT(big, one);
  store.put(key(4), makeTerm(4, 1500), false);
  EXPECT_EQ(store.bytes(), one + big);
  EXPECT_EQ(store.get(key(0)), nullptr);
  EXPECT_EQ(store.get(key(2)), nullptr);
  EXPECT_NE(store.get(key(3)), nullptr);
}

TEST(TermStore, TermLargerThanTheBoundIsNotKeptAndEvictsNothing) {
  TermStore store(10000);
  store.put(key(1), makeTerm(1, 500), false);
  store.put(key(2), makeTerm(2, 50000), false);
  EXPECT_EQ(store.get(key(2)), nullptr);
  EXPECT_NE(store.get(key(1)), nullptr);
  store.put(key(1), makeTerm(3, 50000), false);  // its older value must not be served in its place
  EXPECT_EQ(store.get(key(1)), nullptr);
  EXPECT_EQ(store.bytes(), 0u);
}

/// One plane of so many floats, in memory that the system has just mapped or in a block that was used before.
TermPtr ofMemory(size_t floats, bool fresh) {
  std::vector<TermPtr> others;
  for (int i = 0; i < 1000; ++i) {  // the pool has less
    TermPtr term = makeTerm(i, int(floats));
    if ((term->freshBytes() > 0) == fresh) return term;
    if (fresh) others.push_back(std::move(term));
  }
  return nullptr;
}

TEST(TermStore, OfWhatIsFasterMadeThanMemoryIsToBeHadTheLastFewOfANodeStay) {
  const size_t floats = TermStore::kCheapBytes / sizeof(float);
  const TermPtr large = ofMemory(floats, false), small = makeTerm(1, floats / 8);
  const double all = TermStore::kCheapMsPerMiB * double(large->bytes()) / double(1 << 20), cheap = 0.99 * all, dear = 1.01 * all;
  TermStore store(1ull << 40);
  const auto held = [&](int first, int count) {
    int n = 0;
    for (int i = first; i < first + count; ++i) n += store.holds(key(i)) != TermStore::Tier::None;
    return n;
  };
  const int most = int(TermStore::kCheapVariants);
  for (int i = 0; i < 20; ++i) store.put(key(i), large, false, {}, {"style_transfer:key", "s", cheap, 0});
  EXPECT_EQ(held(0, 20), most);
  EXPECT_EQ(held(20 - most, most), most) << "the last ones";
  for (int i = 100; i < 120; ++i) store.put(key(i), large, false, {}, {"style_transfer:key", "s", dear, 0});
  EXPECT_EQ(held(100, 20), 20) << "worth keeping";
  for (int i = 200; i < 220; ++i) store.put(key(i), small, false, {}, {"style_transfer:key", "s", 0.0, 0});
  EXPECT_EQ(held(200, 20), 20) << "small: no block of its own";
  for (int i = 300; i < 320; ++i) store.put(key(i), large, false);
  EXPECT_EQ(held(300, 20), 20) << "of no node";
  for (int i = 400; i < 402; ++i) store.put(key(i), large, false, {}, {"style_transfer:fill", "s", cheap, 0});
  for (int i = 500; i < 502; ++i) store.put(key(i), large, false, {}, {"style_transfer:key", "other", cheap, 0});
  EXPECT_EQ(held(400, 2) + held(500, 2), 4) << "other nodes and scenes have their own";
  EXPECT_EQ(held(20 - most, most), most);
  // Used again it stays, and what has not been used for longest goes.
  EXPECT_NE(store.get(key(20 - most)), nullptr);
  store.put(key(20), large, false, {}, {"style_transfer:key", "s", cheap, 0});
  EXPECT_EQ(held(20 - most, 1), 1);
  EXPECT_EQ(held(21 - most, 1), 0);
  // Pins count and stay.
  ASSERT_TRUE(store.pin([](const StoredTerm& row) { return row.key == key(20); }).ok());
  for (int i = 21; i < 40; ++i) store.put(key(i), large, false, {}, {"style_transfer:key", "s", cheap, 0});
  EXPECT_EQ(held(20, 1), 1);
  EXPECT_EQ(held(0, 40), most);
  store.erase(key(39));
  store.put(key(40), large, false, {}, {"style_transfer:key", "s", cheap, 0});
  EXPECT_EQ(held(0, 41), most);
  store.clear(false);
  for (int i = 0; i < 3; ++i) store.put(key(i), large, false, {}, {"style_transfer:key", "s", cheap, 0});
  EXPECT_EQ(held(0, 41), 3);
}

TEST(TermStore, WhatFreshMemoryTakesIsNoWorkOfTheNode) {
  const size_t floats = TermStore::kCheapBytes / sizeof(float);
  for (const bool fresh : {false, true}) {
    const TermPtr term = ofMemory(floats, fresh);
    ASSERT_TRUE(term);
    const double mib = double(1 << 20), work = TermStore::kCheapMsPerMiB * double(term->bytes()) / mib;
    const double most = work + (fresh ? TermStore::kFreshMsPerMiB * double(floats * sizeof(float)) / mib : 0.0);
    const auto kept = [&](double ms) {
      TermStore store(1ull << 40);
      for (int i = 0; i < 20; ++i) store.put(key(i), term, false, {}, {"composite", "s", ms, 0});
      return int(store.count());
    };
    EXPECT_EQ(kept(0.99 * most), 4) << fresh;
    EXPECT_EQ(kept(1.01 * most), 20) << fresh;
  }
}

TEST(Term, KnowsHowMuchOfItsMemoryIsFresh) {
  const size_t floats = TermStore::kCheapBytes / sizeof(float);
  EXPECT_EQ(makeTerm(0, 1000)->freshBytes(), 0u) << "small: the heap's";
  TermPtr fresh = ofMemory(floats, true);
  EXPECT_EQ(fresh->freshBytes(), floats * sizeof(float));
  const Term copy = Term("t", Domain::Pixel, Extent{1, 1, 1});
  EXPECT_EQ(copy.freshBytes(), 0u);
  ZeroedBytes given(TermStore::kCheapBytes), taken;
  const bool was = given.fresh();
  taken = std::move(given);
  EXPECT_EQ(taken.fresh(), was) << "goes along with its block";
}

TEST(TermStore, PutOfTheSameKeyReplacesAndReadersKeepTheirs) {
  TermStore store(1 << 20);
  store.put(key(1), makeTerm(1, 100), false);
  const TermPtr held = store.get(key(1));
  store.put(key(1), makeTerm(2, 300), false);
  EXPECT_EQ(store.get(key(1))->content(), makeTerm(2, 300)->content());
  EXPECT_EQ(held->content(), makeTerm(1, 100)->content());
  EXPECT_EQ(store.bytes(), makeTerm(2, 300)->bytes());
  store.erase(key(1));
  EXPECT_EQ(store.get(key(1)), nullptr);
  EXPECT_EQ(store.bytes(), 0u);
}

TEST(TermStore, DiskHitMovesIntoMemory) {
  TempFolder folder;
  {
    TermStore store(1 << 20, std::move(*DiskStore::open(folder.path, 1 << 20)));
    store.put(key(1), makeTerm(1, 1000), true);
    store.put(key(2), makeTerm(2, 1000), false);
    EXPECT_GT(store.diskBytes(), 4000u);
  }
  TermStore store(1 << 20, std::move(*DiskStore::open(folder.path, 1 << 20)));
  TermStore::Tier tier;
  const TermPtr first = store.get(key(1), &tier);
  ASSERT_NE(first, nullptr);
  EXPECT_EQ(tier, TermStore::Tier::Disk);
  EXPECT_EQ(first->content(), makeTerm(1, 1000)->content());
  EXPECT_EQ(store.get(key(1), &tier), first);
  EXPECT_EQ(tier, TermStore::Tier::Memory);
  EXPECT_EQ(store.get(key(2), &tier), nullptr);  // was not to persist
  EXPECT_EQ(tier, TermStore::Tier::None);
}

TEST(TermStore, ClearWithAndWithoutDisk) {
  TempFolder folder;
  TermStore store(1 << 20, std::move(*DiskStore::open(folder.path, 1 << 20)));
  store.put(key(1), makeTerm(1, 1000), true);
  store.clear(false);
  EXPECT_EQ(store.bytes(), 0u);
  EXPECT_EQ(store.count(), 0u);
  EXPECT_NE(store.get(key(1)), nullptr);
  store.clear(true);
  EXPECT_EQ(store.get(key(1)), nullptr);
  EXPECT_EQ(store.diskBytes(), 0u);
  store.put(key(1), makeTerm(1, 1000), true);
  store.erase(key(1));
  EXPECT_EQ(store.get(key(1)), nullptr);  // from both tiers
}

TEST(TermStore, LargeTermStillGoesToDisk) {
  TempFolder folder;
  TermStore store(1000, std::move(*DiskStore::open(folder.path, 1 << 20)));
  store.put(key(1), makeTerm(1, 5000), true);
  TermStore::Tier tier;
  EXPECT_NE(store.get(key(1), &tier), nullptr);
  EXPECT_EQ(tier, TermStore::Tier::Disk);
  EXPECT_EQ(store.bytes(), 0u);
}

TEST(TermStore, FailingDiskIsCountedAndTheTermStaysInMemory) {
  TempFolder folder;
  DiskStoreOptions options;
  options.step = [](const char* step) { return std::string(step) == "write" ? ENOSPC : 0; };
  TermStore store(1 << 20, std::move(*DiskStore::open(folder.path, options)));
  store.put(key(1), makeTerm(1, 1000), true);
  EXPECT_EQ(store.diskErrors(), 1u);
  EXPECT_EQ(store.lastDiskError().code(), Code::ResourceExhausted);
  EXPECT_NE(store.get(key(1)), nullptr);
}

TEST(TermStore, ThreadsHammeringNeverSeeAWrongTermNorPassTheBound) {
  TempFolder folder;
  const uint64_t bound = 20 * makeTerm(0, 200)->bytes();
  TermStore store(bound, std::move(*DiskStore::open(folder.path, 40 * 1200)));
  std::atomic<int> wrong{0}, hits{0};
  std::vector<Hash128> expected;
  for (int i = 0; i < 64; ++i) expected.push_back(makeTerm(i, 200)->content());
  std::vector<std::thread> threads;
  for (int t = 0; t < 8; ++t)
    threads.emplace_back([&, t] {
      uint64_t state = 977 * (t + 1);
      for (int n = 0; n < 400; ++n) {
        state = state * 6364136223846793005ull + 1442695040888963407ull;
        const int i = int(state >> 33) % 64;
        const int what = int(state >> 40) % 100;
        if (what < 50) {
          if (const TermPtr term = store.get(key(i))) {
            ++hits;
            if (term->content() != expected[i]) ++wrong;
          }
        } else if (what < 97) {
          store.put(key(i), makeTerm(i, 200), what < 53);
        } else {
          store.erase(key(i));
        }
        if (store.bytes() > bound) ++wrong;
      }
    });
  for (auto& t : threads) t.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(hits, 50);
  EXPECT_EQ(store.diskErrors(), 0u);
}

}  // namespace
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// TermStore as people see it: lists, eviction by name, pins. And DiskStore's part of them, over restarts and against eviction for room.
#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "plan/disk_index.h"
#include "plan/disk_store.h"
#include "plan/store.h"
#include "unit/plan/term_maker.h"

namespace gobo::store_pins_test {
namespace {

using test::key;
using test::makeTerm;
using test::TempFolder;

constexpr int kElements = 1000;
const uint64_t kOne = makeTerm(0, kElements)->bytes();

auto only(std::vector<int> which) {
  return [which](const StoredTerm& row) { return std::any_of(which.begin(), which.end(), [&](int i) { return row.key == key(i); }); };
}
bool every(const StoredTerm&) { return true; }
void put(TermStore& store, int i, bool persist = false) {
  store.put(key(i), makeTerm(i, kElements), persist, {}, {"label " + std::to_string(i), i % 2 ? "odd" : "even", double(i), 0});
}
std::unique_ptr<DiskStore> disk(const TempFolder& folder, uint64_t most) { return std::move(*DiskStore::open(folder.path, most)); }
uint64_t fileBytes() {
  TempFolder folder;
  auto store = disk(folder, 1 << 20);
  EXPECT_TRUE(store->put(key(0), *makeTerm(0, kElements)).ok());
  return store->bytes();
}

TEST(StorePins, PinnedTermsStayWhileOthersLeave) {
  TermStore store(4 * kOne);
  for (int i = 0; i < 4; ++i) put(store, i);
  const auto pinned = store.pin(only({0, 2}));
  ASSERT_TRUE(pinned.ok()) << pinned.status().toString();
  EXPECT_EQ(pinned->size(), 2u);
  EXPECT_EQ(store.pinnedBytes(), 2 * kOne);
  for (int i = 4; i < 20; ++i) put(store, i);
  EXPECT_EQ(store.bytes(), 4 * kOne);
  EXPECT_NE(store.get(key(0)), nullptr);
  EXPECT_NE(store.get(key(2)), nullptr);
  EXPECT_EQ(store.get(key(1)), nullptr);
  store.shrink(0);
  EXPECT_EQ(store.bytes(), 2 * kOne) << "nor does memory that is short drive them out";
  ASSERT_EQ(store.unpin(only({0}))->size(), 1u);
  for (int i = 20; i < 24; ++i) put(store, i);
  EXPECT_EQ(store.get(key(0)), nullptr);
  EXPECT_NE(store.get(key(2)), nullptr);
  EXPECT_EQ(store.pinnedBytes(), kOne);
  store.clear(false);
  EXPECT_EQ(store.bytes(), 0u);
  EXPECT_EQ(store.pinnedBytes(), 0u);
  EXPECT_EQ(store.count(), 0u);
}

TEST(StorePins, AtMostHalfAndAllOrNothing) {
  TermStore store(4 * kOne);
  for (int i = 0; i < 4; ++i) put(store, i);
  const auto three = store.pin(only({0, 1, 2}));
  EXPECT_EQ(three.status().code(), Code::FailedPrecondition);
  EXPECT_NE(three.status().message().find("engine.store_bytes"), std::string::npos);
  EXPECT_EQ(store.pinnedBytes(), 0u);
  ASSERT_TRUE(store.pin(only({0})).ok());
  ASSERT_TRUE(store.pin(only({0, 1})).ok()) << "one of them is pinned already";
  EXPECT_FALSE(store.pin(only({2})).ok());
  EXPECT_TRUE(store.pin(only({77}))->empty());
}

TEST(StorePins, ATermThatPinsLeaveNoRoomForIsNotKept) {
  TermStore store(4 * kOne);
  put(store, 0), put(store, 1);
  ASSERT_TRUE(store.pin(every).ok());
  store.put(key(2), makeTerm(2, 3 * kElements), false);
  EXPECT_EQ(store.get(key(2)), nullptr);
  EXPECT_EQ(store.bytes(), 2 * kOne);
  put(store, 0);  // again: still pinned
  EXPECT_EQ(store.pinnedBytes(), 2 * kOne);
}

TEST(StorePins, EvictionByNameLeavesPinnedOnes) {
  TempFolder folder;
  TermStore store(1 << 20, disk(folder, 1 << 20));
  for (int i = 0; i < 6; ++i) put(store, i, i < 4);  // 4 and 5 in memory alone
  ASSERT_TRUE(store.pin(only({1, 5})).ok());
  const auto odd = [](const StoredTerm& row) { return row.note.scene == "odd"; };
  auto gone = store.evict(odd, /*disk=*/false, /*pinned=*/false);
  ASSERT_EQ(gone.size(), 1u);
  EXPECT_EQ(gone[0].key, key(3));
  EXPECT_EQ(gone[0].bytes, kOne);
  EXPECT_EQ(gone[0].diskBytes, 0u);
  EXPECT_EQ(store.holds(key(3)), TermStore::Tier::Disk);
  gone = store.evict(odd, true, false);
  ASSERT_EQ(gone.size(), 1u);
  EXPECT_EQ(gone[0].bytes, 0u);
  EXPECT_GT(gone[0].diskBytes, 0u);
  EXPECT_EQ(store.holds(key(3)), TermStore::Tier::None);
  EXPECT_EQ(store.holds(key(0)), TermStore::Tier::Memory);
  EXPECT_EQ(store.evict(odd, true, true).size(), 2u);
  EXPECT_EQ(store.pinnedBytes(), 0u);
  EXPECT_EQ(store.pinnedDiskBytes(), 0u);
  put(store, 5);  // a pin ends with its term
  EXPECT_FALSE(store.list()[0].pinned || store.pinnedBytes() > 0);
}

TEST(StorePins, ListTellsOfBothTiers) {
  TempFolder folder;
  {
    TermStore store(1 << 20, disk(folder, 1 << 20));
    put(store, 3, true);
    put(store, 4, false);
    ASSERT_EQ(store.list().size(), 2u);
  }
  TermStore store(1 << 20, disk(folder, 1 << 20));
  auto rows = store.list();
  ASSERT_EQ(rows.size(), 1u);
  EXPECT_EQ(rows[0].key, key(3));
  EXPECT_EQ(rows[0].type, "test.3");
  EXPECT_EQ(rows[0].note.label, "label 3");
  EXPECT_EQ(rows[0].note.scene, "odd");
  EXPECT_EQ(rows[0].note.ms, 3.0);
  EXPECT_EQ(rows[0].bytes, 0u);
  EXPECT_GT(rows[0].diskBytes, uint64_t(4 * kElements));
  const int64_t before = rows[0].used;
  ASSERT_NE(store.get(key(3)), nullptr);
  rows = store.list();
  ASSERT_EQ(rows.size(), 1u);
  EXPECT_EQ(rows[0].bytes, kOne);
  EXPECT_EQ(rows[0].note.label, "label 3");
  EXPECT_GT(rows[0].used, before);
}

TEST(StorePins, PinsOnDiskOutliveTheProcess) {
  TempFolder folder;
  const uint64_t one = fileBytes();
  {
    TermStore store(1 << 20, disk(folder, 4 * one + 100));
    for (int i = 0; i < 4; ++i) put(store, i, true);
    ASSERT_TRUE(store.pin(only({1})).ok());
    EXPECT_EQ(store.pinnedDiskBytes(), one);
    EXPECT_EQ(store.pin(only({2, 3})).status().code(), Code::FailedPrecondition);
    EXPECT_EQ(store.pinnedDiskBytes(), one) << "all or nothing";
  }
  TermStore store(1 << 20, disk(folder, 4 * one + 100));
  for (int i = 10; i < 30; ++i) put(store, i, true);
  EXPECT_EQ(store.diskBytes(), 4 * one);
  EXPECT_NE(store.get(key(1)), nullptr);
  EXPECT_EQ(store.pinnedBytes(), kOne) << "in memory too, now that it is there";
  store.put(key(1), makeTerm(2, kElements), true);  // replaced under its key: the pin stays
  EXPECT_EQ(store.pinnedDiskBytes(), one);
  ASSERT_TRUE(store.unpin(every).ok());
  for (int i = 30; i < 40; ++i) put(store, i, true);
  store.clear(false);
  EXPECT_EQ(store.get(key(1)), nullptr);
}

TEST(StorePins, WhatIsPinnedOnDiskFillsHalfOfMemoryAtMost) {
  TempFolder folder;
  TermStore store(4 * kOne, disk(folder, 1 << 20));
  for (int i = 0; i < 3; ++i) put(store, i, true);
  ASSERT_EQ(store.pin(every)->size(), 3u);
  EXPECT_EQ(store.pinnedBytes(), 2 * kOne);
  for (int i = 0; i < 3; ++i) put(store, i, true);
  EXPECT_EQ(store.pinnedBytes(), 2 * kOne);
  for (int i = 10; i < 20; ++i) put(store, i);
  for (int i = 0; i < 3; ++i) EXPECT_NE(store.get(key(i)), nullptr) << i << ", from its file at least";
  EXPECT_EQ(store.pinnedBytes(), 2 * kOne);
}

TEST(StorePins, AFileThatPinsLeaveNoRoomForIsNotKept) {
  TempFolder folder;
  const uint64_t one = fileBytes();
  auto store = disk(folder, 4 * one);
  const Hash128 keys[] = {key(0), key(1)};
  for (int i = 0; i < 2; ++i) ASSERT_TRUE(store->put(key(i), *makeTerm(i, kElements)).ok());
  ASSERT_TRUE(store->pin(keys, true).ok());
  ASSERT_TRUE(store->put(key(2), *makeTerm(2, 3 * kElements)).ok());
  EXPECT_FALSE(store->holds(key(2)));
  EXPECT_EQ(store->bytes(), 2 * one);
}

TEST(StorePins, ALowerBoundTakesPinsBack) {
  TempFolder folder;
  const uint64_t one = fileBytes();
  const Hash128 keys[] = {key(0), key(1), key(2)};
  {
    auto store = disk(folder, 6 * one);
    for (int i = 0; i < 3; ++i) ASSERT_TRUE(store->put(key(i), *makeTerm(i, kElements)).ok());
    ASSERT_TRUE(store->pin(keys, true).ok());
  }
  std::string said;
  DiskStoreOptions options;
  options.maxBytes = 4 * one;
  options.say = [&](const std::string& line) { said += line; };
  auto store = std::move(*DiskStore::open(folder.path, options));
  EXPECT_EQ(store->pinnedBytes(), 2 * one);
  EXPECT_NE(said.find(key(0).hex()), std::string::npos) << said;  // the one that was used longest ago
  EXPECT_TRUE(store->holds(key(0)));
}

TEST(StorePins, ListsAreConsistentWhileOthersWork) {
  TempFolder folder;
  TermStore store(8 * kOne, disk(folder, 1 << 20));
  for (int i = 0; i < 3; ++i) put(store, i, true);
  ASSERT_TRUE(store.pin(only({0, 1, 2})).ok());
  std::atomic<bool> stop{false};
  std::vector<std::thread> threads;
  for (int t = 0; t < 3; ++t)
    threads.emplace_back([&, t] {
      for (int i = 0; !stop; ++i) {
        put(store, 10 + (i + 7 * t) % 20, i % 5 == 0);
        (void)store.get(key(10 + i % 20));
        if (i % 16 == 0) (void)store.evict(only({10 + i % 20}), t == 0, false);
        if (i % 32 == 0) (void)store.pin(only({12}));
        if (i % 32 == 16) (void)store.unpin(only({12}));
      }
    });
  for (int k = 0; k < 60; ++k) {
    const auto rows = store.list();
    uint64_t bytes = 0, found = 0;
    for (size_t i = 0; i < rows.size(); ++i) {
      if (i > 0) { ASSERT_LT(rows[i - 1].key, rows[i].key); }
      ASSERT_TRUE(rows[i].bytes > 0 || rows[i].diskBytes > 0);
      ASSERT_FALSE(rows[i].type.empty());
      bytes += rows[i].bytes;
      found += only({0, 1, 2})(rows[i]) && rows[i].pinned && rows[i].bytes > 0;
    }
    ASSERT_LE(bytes, 8 * kOne);
    ASSERT_EQ(found, 3u);
  }
  stop = true;
  for (std::thread& t : threads) t.join();
  EXPECT_LE(store.pinnedBytes(), 4 * kOne);
}

}  // namespace
}  // namespace gobo::store_pins_test

// SPDX-License-Identifier: Apache-2.0
// A stop while the disk tier writes, reads or waits for its folder: nothing half written stays, nothing good is dropped, and the next
// call does the whole work.
#include <gtest/gtest.h>

#include <fcntl.h>
#include <sys/file.h>

#include "plan/disk_store.h"
#include "plan/store.h"
#include "support/stopping.h"
#include "unit/plan/term_maker.h"

namespace gobo {
namespace {

namespace fs = std::filesystem;
using test::key;
using test::makeTerm;
using test::TempFolder;
using test::termFiles;
using tests::pollsOf;
using tests::stopAt;

constexpr int kElements = 5 << 20;  // 25 MB: seven pieces of 4 MB
constexpr uint64_t kMost = 1ull << 30;

size_t temps(const std::string& folder) { return size_t(std::distance(fs::directory_iterator(folder + "/tmp"), fs::directory_iterator())); }

TEST(DiskStops, AWriteEndsAtAnyPollAndLeavesNothing) {
  TempFolder folder;
  const auto store = std::move(*DiskStore::open(folder.path, kMost));
  const auto term = makeTerm(1, kElements);
  const int polls = pollsOf([&](const StopToken& s) { ASSERT_TRUE(store->put(key(0), *term, s).ok()); });
  EXPECT_GE(polls, 2 * 6);  // copied, then written
  store->erase(key(0));
  for (int k = 1; k <= polls; ++k) {
    EXPECT_EQ(store->put(key(1), *term, stopAt(k)).code(), Code::Cancelled) << k << " of " << polls;
    EXPECT_EQ(termFiles(folder.path).count, 0u) << k;
    EXPECT_EQ(temps(folder.path), 0u) << k;
    EXPECT_EQ(store->count(), 0u) << k;
  }
  EXPECT_EQ(store->get(key(1)), nullptr);
  ASSERT_TRUE(store->put(key(1), *term).ok());
  ASSERT_NE(store->get(key(1)), nullptr);
  EXPECT_EQ(store->get(key(1))->content(), term->content());
}

TEST(DiskStops, AReadEndsAtAnyPollAndTheFileStays) {
  TempFolder folder;
  const auto store = std::move(*DiskStore::open(folder.path, kMost));
  const auto term = makeTerm(1, kElements);
  ASSERT_TRUE(store->put(key(1), *term).ok());
  const int polls = pollsOf([&](const StopToken& s) { ASSERT_NE(store->get(key(1), s), nullptr); });
  EXPECT_GE(polls, 2 * 6);
  for (int k = 1; k <= polls; ++k) EXPECT_EQ(store->get(key(1), stopAt(k)), nullptr) << k << " of " << polls;
  EXPECT_EQ(store->stats().damaged, 0u);
  EXPECT_EQ(termFiles(folder.path).count, 1u);
  ASSERT_NE(store->get(key(1)), nullptr);
  EXPECT_EQ(store->get(key(1))->content(), term->content());
}

TEST(DiskStops, WaitingForTheFolderEnds) {
  TempFolder folder;
  const auto store = std::move(*DiskStore::open(folder.path, kMost));
  const int held = ::open((folder.path + "/lock").c_str(), O_RDWR | O_CLOEXEC);  // as another process would
  ASSERT_EQ(::flock(held, LOCK_EX), 0);
  EXPECT_EQ(store->put(key(1), *makeTerm(1, 10), stopAt(3)).code(), Code::Cancelled);
  ::close(held);
  EXPECT_EQ(temps(folder.path), 0u);
  EXPECT_TRUE(store->put(key(1), *makeTerm(1, 10)).ok());
}

TEST(DiskStops, AStoppedWriteIsNoErrorOfTheDiskAndTheTermStaysInMemory) {
  TempFolder folder;
  TermStore store(kMost, std::move(*DiskStore::open(folder.path, kMost)));
  store.put(key(1), makeTerm(1, kElements), true, tests::stoppedAlready());
  EXPECT_EQ(store.diskErrors(), 0u);
  EXPECT_EQ(termFiles(folder.path).count, 0u);
  EXPECT_NE(store.get(key(1)), nullptr);
}

}  // namespace
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// DiskStore in one process: round trips, the bound and its order, damage of every kind, and the index as a mere cache of the
// files. What several processes and kill -9 do: disk_store_crash_test.cpp.
#include "plan/disk_store.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cstring>
#include <fstream>
#include <limits>
#include <thread>

#include "terms/term_file.h"
#include "unit/plan/term_maker.h"

namespace gobo {
namespace {

namespace fs = std::filesystem;
using test::fileOf;
using test::key;
using test::makeTerm;
using test::TempFolder;
using test::termFiles;

std::vector<uint8_t> slurp(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}
void spill(const std::string& path, const std::vector<uint8_t>& bytes) {
  std::ofstream(path, std::ios::binary).write(reinterpret_cast<const char*>(bytes.data()), std::streamsize(bytes.size()));
}
std::unique_ptr<DiskStore> openStore(const std::string& folder, uint64_t maxBytes = 1 << 20) {
  auto store = DiskStore::open(folder, maxBytes);
  EXPECT_TRUE(store.ok()) << store.status().toString();
  return store.ok() ? std::move(*store) : nullptr;
}

TEST(DiskStore, RoundTripIsBitExactForEveryFormatAndOddFloats) {
  TempFolder folder;
  Term term("odd", Domain::ViewSample, {3, 5, 2});
  auto f = term.addPlane<float>("f", 2);
  uint32_t state = 1;
  for (float& v : f) {
    state = state * 1664525u + 1013904223u;
    std::memcpy(&v, &state, 4);  // any bits: signalling NaN, denormal, infinity
  }
  f[0] = -0.0f;
  f[1] = std::numeric_limits<float>::signaling_NaN();
  term.addPlane<double>("d")[7] = 0x1.fffffffffffffp-1022;
  term.addPlane<uint32_t>("u")[3] = 0xdeadbeefu;
  term.addPlane<uint8_t>("b", 3)[8] = 255;
  term.addPlane<float>("", 1)[0] = 1;  // an empty name is a name
  auto store = openStore(folder.path);
  ASSERT_TRUE(store->put(key(1), term).ok());
  const TermPtr back = store->get(key(1));
  ASSERT_NE(back, nullptr);
  EXPECT_EQ(back->type(), "odd");
  EXPECT_EQ(back->domain(), Domain::ViewSample);
  EXPECT_EQ(back->extent(), term.extent());
  ASSERT_EQ(back->planes().size(), term.planes().size());
  for (size_t i = 0; i < term.planes().size(); ++i) {
    EXPECT_EQ(back->planes()[i].name, term.planes()[i].name);
    EXPECT_EQ(back->planes()[i].format, term.planes()[i].format);
    EXPECT_EQ(back->planes()[i].channels, term.planes()[i].channels);
    EXPECT_EQ(back->planes()[i].bytes, term.planes()[i].bytes);
  }
  EXPECT_EQ(back->content(), term.content());
  const Term empty("nothing", Domain::List, {0, 1, 1});
  ASSERT_TRUE(store->put(key(2), empty).ok());
  ASSERT_NE(store->get(key(2)), nullptr);
  EXPECT_EQ(store->get(key(3)), nullptr);
}

TEST(DiskStore, FolderThatCannotBeWrittenIsAnErrorThatNamesIt) {
  const auto bad = DiskStore::open("/proc/gobo-cache", 1 << 20);
  ASSERT_FALSE(bad.ok());
  EXPECT_NE(bad.status().toString().find("/proc/gobo-cache"), std::string::npos);
  TempFolder folder;
  spill(folder.path + "/file", {1});
  EXPECT_FALSE(DiskStore::open(folder.path + "/file", 1 << 20).ok());
}

TEST(DiskStore, EvictsLeastRecentlyUsedAndFilesStayWithinTheBound) {
  TempFolder folder;
  const uint64_t one = serializeTerm(*makeTerm(0, 1000), key(0)).size();
  DiskStoreOptions options;
  options.maxBytes = 3 * one;
  int64_t now = 1'000'000'000;
  options.nowMicros = [&] { return now += 1000; };
  uint64_t worst = 0;
  options.step = [&](const char*) {
    worst = std::max(worst, termFiles(folder.path).bytes);
    return 0;
  };
  auto store = std::move(*DiskStore::open(folder.path, options));
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(store->put(key(i), *makeTerm(i, 1000)).ok());
  EXPECT_EQ(store->bytes(), 3 * one);
  ASSERT_NE(store->get(key(0)), nullptr);
  ASSERT_TRUE(store->put(key(3), *makeTerm(3, 1000)).ok());
  EXPECT_EQ(store->get(key(1)), nullptr);
  for (int i : {0, 2, 3}) EXPECT_NE(store->get(key(i)), nullptr) << i;
  ASSERT_TRUE(store->put(key(4), *makeTerm(4, 2000)).ok());  // two must go: of 0, 2, 3 the last read stays
  EXPECT_EQ(store->get(key(0)), nullptr);
  EXPECT_EQ(store->get(key(2)), nullptr);
  EXPECT_NE(store->get(key(3)), nullptr);
  EXPECT_EQ(store->bytes(), termFiles(folder.path).bytes);
  EXPECT_LE(worst, options.maxBytes);  // at every step, not only at the end
  EXPECT_EQ(store->stats().evicted, 3u);
  const uint64_t before = store->bytes();
  ASSERT_TRUE(store->put(key(5), *makeTerm(5, 4000)).ok());  // larger than the bound: not kept, nothing evicted for it
  EXPECT_EQ(store->get(key(5)), nullptr);
  EXPECT_EQ(store->bytes(), before);
}

TEST(DiskStore, LastUseSurvivesReopeningAndOpenAppliesASmallerBound) {
  TempFolder folder;
  const uint64_t one = serializeTerm(*makeTerm(0, 1000), key(0)).size();
  {
    auto store = openStore(folder.path, 10 * one);
    for (int i = 0; i < 5; ++i) ASSERT_TRUE(store->put(key(i), *makeTerm(i, 1000)).ok());
    ASSERT_NE(store->get(key(0)), nullptr);
    ASSERT_NE(store->get(key(2)), nullptr);
  }
  auto store = openStore(folder.path, 2 * one);
  EXPECT_EQ(store->count(), 2u);
  EXPECT_NE(store->get(key(0)), nullptr);
  EXPECT_NE(store->get(key(2)), nullptr);
  EXPECT_EQ(termFiles(folder.path).count, 2u);
}

TEST(DiskStore, PutOfAnotherValueReplacesAndOfTheSameWritesNothing) {
  TempFolder folder;
  auto store = openStore(folder.path);
  ASSERT_TRUE(store->put(key(1), *makeTerm(1, 1000)).ok());
  ASSERT_TRUE(store->put(key(1), *makeTerm(1, 1000)).ok());
  EXPECT_EQ(store->stats().writes, 1u);
  ASSERT_TRUE(store->put(key(1), *makeTerm(2, 3000)).ok());  // more sample blocks under the same key
  EXPECT_EQ(store->stats().writes, 2u);
  EXPECT_EQ(store->get(key(1))->content(), makeTerm(2, 3000)->content());
  EXPECT_EQ(store->bytes(), serializeTerm(*makeTerm(2, 3000), key(2)).size());
  EXPECT_EQ(store->count(), 1u);
}

TEST(DiskStore, ReplacingTheLargestTermDoesNotEvictTheOthers) {
  TempFolder folder;
  const uint64_t one = serializeTerm(*makeTerm(0, 1000), key(0)).size();
  auto store = openStore(folder.path, 3 * one);
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(store->put(key(i), *makeTerm(i, 1000)).ok());
  ASSERT_TRUE(store->put(key(1), *makeTerm(8, 1000)).ok());
  EXPECT_EQ(store->count(), 3u);
  EXPECT_EQ(store->stats().evicted, 0u);
}

TEST(DiskStore, TruncatedOrFlippedFileIsNullNeverWrongAndIsDropped) {
  TempFolder folder;
  auto store = openStore(folder.path);
  const auto term = makeTerm(1, 1000);
  ASSERT_TRUE(store->put(key(1), *term).ok());
  const std::string file = fileOf(folder.path, 1);
  const auto good = slurp(file);
  ASSERT_GT(good.size(), 4000u);
  uint64_t damaged = 0;
  const auto expectDropped = [&](const std::vector<uint8_t>& bytes, const char* what, size_t at) {
    spill(file, bytes);
    EXPECT_EQ(store->get(key(1)), nullptr) << what << " at " << at;
    EXPECT_FALSE(fs::exists(file)) << what << " at " << at;
    EXPECT_EQ(store->stats().damaged, ++damaged);
    EXPECT_EQ(store->count(), 0u);
    ASSERT_TRUE(store->put(key(1), *term).ok());
  };
  for (size_t at = 0; at < good.size(); at += 100) {
    expectDropped({good.begin(), good.begin() + long(at)}, "truncated", at);
    for (int bit : {0, 7}) {
      auto bytes = good;
      bytes[at] ^= uint8_t(1 << bit);
      expectDropped(bytes, "flipped", at);
    }
  }
  for (size_t at = good.size() - 16; at < good.size(); ++at) {  // the digest itself
    auto bytes = good;
    bytes[at] ^= 4;
    expectDropped(bytes, "digest", at);
  }
  auto longer = good;
  longer.push_back(0);
  expectDropped(longer, "longer", longer.size());
  EXPECT_EQ(store->get(key(1))->content(), term->content());
}

TEST(DiskStore, OddThingsInTheFolderAreNotFollowedAndForeignFilesStay) {
  TempFolder folder;
  auto store = openStore(folder.path);
  ASSERT_TRUE(store->put(key(1), *makeTerm(1, 10)).ok());
  const std::string file = fileOf(folder.path, 1);
  fs::remove(file);
  fs::create_directory(file);  // a folder where a file should be
  EXPECT_EQ(store->get(key(1)), nullptr);
  fs::remove(file);
  spill(folder.path + "/outside", serializeTerm(*makeTerm(1, 10), key(1)));
  fs::create_symlink(folder.path + "/outside", file);  // a link is not followed
  EXPECT_EQ(store->get(key(1)), nullptr);
  const std::string foreign = folder.path + "/" + key(1).hex().substr(0, 2) + "/readme.txt";
  spill(foreign, {1, 2, 3});
  store = nullptr;
  store = openStore(folder.path);
  store->clear();
  EXPECT_TRUE(fs::exists(foreign));
  EXPECT_TRUE(fs::exists(folder.path + "/outside"));
  EXPECT_EQ(store->count(), 0u);
}

TEST(DiskStore, IndexIsRebuiltWhenMissingDamagedOrOfAnotherVersion) {
  for (const char* how : {"missing", "garbage", "flipped", "empty", "foreign"}) {
    TempFolder folder;
    {
      auto store = openStore(folder.path);
      for (int i = 0; i < 20; ++i) ASSERT_TRUE(store->put(key(i), *makeTerm(i, 500)).ok());
    }
    const std::string index = folder.path + "/index.sqlite";
    auto bytes = slurp(index);
    const std::string kind = how;
    if (kind == "missing")
      for (const char* tail : {"", "-wal", "-shm"}) fs::remove(index + tail);
    if (kind == "garbage") {
      spill(index, std::vector<uint8_t>(9000, 0x5a));
      fs::remove(index + "-wal");
    }  // the log would heal it
    if (kind == "empty") spill(index, {});
    if (kind == "foreign") {
      bytes[60 + 3] = 99;
      spill(index, bytes);
      fs::remove(index + "-wal");
    }  // user_version
    if (kind == "flipped") {
      for (size_t at = 100; at < bytes.size(); at += 50) bytes[at] ^= 0xff;
      spill(index, bytes);
      fs::remove(index + "-wal");
    }
    auto store = openStore(folder.path);
    EXPECT_EQ(store->count(), 20u) << how;
    EXPECT_EQ(store->bytes(), termFiles(folder.path).bytes) << how;
    for (int i = 0; i < 20; ++i) {
      const TermPtr term = store->get(key(i));
      ASSERT_NE(term, nullptr) << how;
      EXPECT_EQ(term->content(), makeTerm(i, 500)->content());
    }
    EXPECT_EQ(store->stats().rebuilds, kind == "empty" ? 0u : 1u) << how;  // an empty file is a new index to SQLite
  }
}

TEST(DiskStore, IndexRemovedOrReplacedUnderARunningStore) {
  TempFolder folder;
  auto a = openStore(folder.path), b = openStore(folder.path);
  ASSERT_TRUE(a->put(key(1), *makeTerm(1, 500)).ok());
  for (const char* tail : {"", "-wal", "-shm"}) fs::remove(folder.path + "/index.sqlite" + tail);
  ASSERT_TRUE(a->put(key(2), *makeTerm(2, 500)).ok());  // makes it anew
  ASSERT_TRUE(b->put(key(3), *makeTerm(3, 500)).ok());  // moves over to the new one
  EXPECT_EQ(a->count(), 3u);
  EXPECT_EQ(b->count(), 3u);
  EXPECT_EQ(a->stats().rebuilds, 1u);
  a = nullptr;  // its close must not take the log of b's index away
  ASSERT_TRUE(b->put(key(4), *makeTerm(4, 500)).ok());
  b = nullptr;
  EXPECT_EQ(openStore(folder.path)->count(), 4u);
}

TEST(DiskStore, WholeFolderRemovedUnderARunningStore) {
  TempFolder folder;
  auto store = openStore(folder.path + "/cache");
  ASSERT_TRUE(store->put(key(1), *makeTerm(1, 500)).ok());
  fs::remove_all(folder.path + "/cache");
  EXPECT_EQ(store->get(key(1)), nullptr);
  const Status status = store->put(key(2), *makeTerm(2, 500));
  EXPECT_TRUE(status.ok()) << status.toString();
  EXPECT_NE(store->get(key(2)), nullptr);
  EXPECT_EQ(store->count(), 1u);
}

TEST(DiskStore, MissingFilesAndOrphansAreReconciled) {
  TempFolder folder;
  auto store = openStore(folder.path);
  for (int i = 0; i < 4; ++i) ASSERT_TRUE(store->put(key(i), *makeTerm(i, 500)).ok());
  fs::remove(fileOf(folder.path, 0));
  EXPECT_EQ(store->get(key(0)), nullptr);  // its row goes when it is asked for
  EXPECT_EQ(store->count(), 3u);
  EXPECT_EQ(store->stats().missing, 1u);
  fs::remove(fileOf(folder.path, 1));
  const std::string orphan = fileOf(folder.path, 9);
  fs::create_directories(fs::path(orphan).parent_path());
  spill(orphan, serializeTerm(*makeTerm(9, 500), key(9)));
  EXPECT_NE(store->get(key(9)), nullptr);  // found without a row
  store = nullptr;
  store = openStore(folder.path);
  EXPECT_EQ(store->count(), 3u);
  EXPECT_EQ(store->bytes(), termFiles(folder.path).bytes);
  EXPECT_EQ(store->stats().missing, 1u);
  EXPECT_NE(store->get(key(9)), nullptr);
}

TEST(DiskStore, StaleTempsLeaveByAgeOnly) {
  TempFolder folder;
  { auto store = openStore(folder.path); }
  spill(folder.path + "/tmp/1-2-3-0.tmp", {1, 2, 3});
  DiskStoreOptions options;
  options.staleTempSeconds = 900;
  const int64_t now = std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch()).count();
  options.nowMicros = [=] { return now + 600 * 1000000ll; };
  EXPECT_EQ((*DiskStore::open(folder.path, options))->stats().staleTemps, 0u);
  EXPECT_TRUE(fs::exists(folder.path + "/tmp/1-2-3-0.tmp"));  // may be a living writer's
  options.nowMicros = [=] { return now + 1000 * 1000000ll; };
  EXPECT_EQ((*DiskStore::open(folder.path, options))->stats().staleTemps, 1u);
  EXPECT_TRUE(fs::is_empty(folder.path + "/tmp"));
}

// A store that was opened while the clock was ten years ahead does not wait for that year.
TEST(DiskStore, TemporariesGoThoughTheClockWasSetBack) {
  TempFolder folder;
  const int64_t right = std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch()).count();
  int64_t now = right + 10ll * 365 * 86400 * 1000000;
  DiskStoreOptions options;
  options.staleTempSeconds = 900;
  options.nowMicros = [&] { return now; };
  const auto store = std::move(*DiskStore::open(folder.path, options));
  now = right;
  ASSERT_TRUE(store->put(key(1), *makeTerm(1, 10)).ok());
  spill(folder.path + "/tmp/1-2-3-0.tmp", {1, 2, 3});
  now = right + 2ll * 3600 * 1000000;
  ASSERT_TRUE(store->put(key(2), *makeTerm(2, 10)).ok());
  EXPECT_EQ(store->stats().staleTemps, 1u);
}

TEST(DiskStore, FailureOfAnyStepIsReportedAndLeavesNoWrongState) {
  for (const char* failing : {"create", "write", "sync", "evict", "unlink", "rename", "commit", "sync-folder"}) {
    TempFolder folder;
    const uint64_t one = serializeTerm(*makeTerm(0, 500), key(0)).size();
    DiskStoreOptions options;
    options.maxBytes = 2 * one;
    bool armed = false;
    options.step = [&](const char* step) { return armed && std::string(step) == failing ? ENOSPC : 0; };
    auto store = std::move(*DiskStore::open(folder.path, options));
    for (int i = 0; i < 2; ++i) ASSERT_TRUE(store->put(key(i), *makeTerm(i, 500)).ok());
    armed = true;
    const Status status = store->put(key(2), *makeTerm(2, 500));
    EXPECT_FALSE(status.ok()) << failing;
    armed = false;
    EXPECT_TRUE(fs::is_empty(folder.path + "/tmp")) << failing;
    EXPECT_LE(termFiles(folder.path).bytes, options.maxBytes) << failing;
    ASSERT_TRUE(store->put(key(3), *makeTerm(3, 500)).ok()) << failing;  // and it works again
    EXPECT_EQ(store->bytes(), termFiles(folder.path).bytes) << failing;
    EXPECT_LE(store->bytes(), options.maxBytes) << failing;
    for (int i = 0; i < 4; ++i) {
      const TermPtr term = store->get(key(i));
      EXPECT_TRUE(!term || term->content() == makeTerm(i, 500)->content()) << failing;
    }
    EXPECT_NE(store->get(key(3)), nullptr) << failing;
  }
}

TEST(DiskStore, ThreadsHammering) {
  TempFolder folder;
  const uint64_t bound = 12 * serializeTerm(*makeTerm(0, 300), key(0)).size();
  auto store = openStore(folder.path, bound);
  std::atomic<int> wrong{0}, hits{0};
  std::vector<std::thread> threads;
  for (int t = 0; t < 6; ++t)
    threads.emplace_back([&, t] {
      uint64_t state = 31 * (t + 1);
      for (int n = 0; n < 150; ++n) {
        state = state * 6364136223846793005ull + 1442695040888963407ull;
        const int i = int(state >> 33) % 24;
        if ((state >> 60) < 6) {
          if (!store->put(key(i), *makeTerm(i, 300)).ok()) ++wrong;
        } else if (const TermPtr term = store->get(key(i))) {
          ++hits;
          if (term->content() != makeTerm(i, 300)->content()) ++wrong;
        }
        if (store->bytes() > bound) ++wrong;
      }
    });
  for (auto& t : threads) t.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(hits, 20);
  EXPECT_EQ(store->bytes(), termFiles(folder.path).bytes);
  EXPECT_EQ(store->stats().damaged, 0u);
}

}  // namespace
}  // namespace gobo

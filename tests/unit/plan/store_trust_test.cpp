// SPDX-License-Identifier: Apache-2.0
// The term store below a rendering engine: files that trade names, a folder that goes, fills up or is somebody else's, a clock that jumps.
// Whatever happens there, a picture is the one that an engine without a store makes.
#include <gtest/gtest.h>
#include <sys/mount.h>
#include <sys/stat.h>

#include <algorithm>
#include <fstream>
#include <random>

#include "plan/disk_store.h"
#include "plan/store.h"
#include "support/engines.h"
#include "terms/term_file.h"
#include "unit/plan/term_maker.h"

namespace gobo::testing {
namespace {

namespace fs = std::filesystem;
using test::fileOf;
using test::key;
using test::makeTerm;
using test::TempFolder;
using test::termFiles;

std::vector<fs::path> names(const std::string& folder) {
  std::vector<fs::path> out;
  for (const auto& e : fs::recursive_directory_iterator(folder))
    if (e.path().extension() == ".term") out.push_back(e.path());
  std::sort(out.begin(), out.end());
  return out;
}

/// The files under each other's names, none under its own.
void rotate(const std::vector<fs::path>& files) {
  for (const fs::path& f : files) fs::rename(f, f.string() + ".away");
  for (size_t i = 0; i < files.size(); ++i) fs::rename(files[i].string() + ".away", files[(i + 1) % files.size()]);
}

TEST(StoreTrust, FilesThatTradeNamesNeverMakeAPicture) {
  TempFolder folder;
  // Pictures of one size: their terms differ in nothing but the values.
  std::vector<v1::RenderRequest> requests;
  std::vector<RenderResult> right;
  for (int i = 0; i < 12; ++i) {
    v1::RenderRequest r = smallRequest("cornell", 24, 16, 8);
    r.set_seed(uint64_t(i));
    requests.push_back(r);
    right.push_back(mustRender(*makeEngine(), r));
  }
  {
    const auto engine = makeEngine(256ull << 20, folder.path);
    for (const auto& r : requests) mustRender(*engine, r);
  }
  // Some terms are made too quickly to be kept: what an engine keeps is put there by hand as well.
  auto store = std::move(*DiskStore::open(folder.path, 1ull << 30));
  for (int i = 0; i < 30; ++i) ASSERT_TRUE(store->put(key(i), *makeTerm(i, 100 + 2 * (i % 3))).ok());
  store = nullptr;
  const auto files = names(folder.path);
  ASSERT_GE(files.size(), 40u) << "the renders left too few terms for the test to mean anything";
  rotate(files);
  const auto engine = makeEngine(256ull << 20, folder.path);
  for (size_t i = 0; i < requests.size(); ++i) EXPECT_EQ(firstDifference(mustRender(*engine, requests[i]), right[i]), "") << i;
  store = std::move(*DiskStore::open(folder.path, 1ull << 30));
  for (int i = 0; i < 30; ++i) EXPECT_EQ(store->get(key(i)), nullptr) << i;
  EXPECT_EQ(store->stats().damaged, 30u);
  for (int i = 0; i < 30; ++i) EXPECT_FALSE(fs::exists(fileOf(folder.path, i)));
}

TEST(StoreTrust, RandomPairsThatTradeNamesAreDamaged) {
  TempFolder folder;
  std::mt19937 random(7);
  auto store = std::move(*DiskStore::open(folder.path, 1ull << 30));
  for (int round = 0; round < 200; ++round) {
    const int a = int(random() % 1000), b = a + 1 + int(random() % 1000);
    ASSERT_TRUE(store->put(key(a), *makeTerm(a, 50)).ok());
    ASSERT_TRUE(store->put(key(b), *makeTerm(b, 50)).ok());
    rotate({fileOf(folder.path, a), fileOf(folder.path, b)});
    ASSERT_EQ(store->get(key(a)), nullptr) << a << " " << b;
    ASSERT_EQ(store->get(key(b)), nullptr) << a << " " << b;
    ASSERT_EQ(store->stats().damaged, uint64_t(2 * round + 2));
    ASSERT_TRUE(store->put(key(a), *makeTerm(a, 50)).ok());
    ASSERT_EQ(store->get(key(a))->content(), makeTerm(a, 50)->content());
    store->erase(key(a));
  }
}

TEST(StoreTrust, AFileOfAnotherVersionIsAbsentAndReplaced) {
  TempFolder folder;
  auto store = std::move(*DiskStore::open(folder.path, 1 << 20));
  ASSERT_TRUE(store->put(key(1), *makeTerm(1, 50)).ok());
  auto bytes = serializeTerm(*makeTerm(1, 50), key(1));
  bytes[7] = '1';
  const Hash128 digest = hashBytes(bytes.data(), bytes.size() - 16);
  std::memcpy(bytes.data() + bytes.size() - 16, &digest, 16);
  std::ofstream(fileOf(folder.path, 1), std::ios::binary).write(reinterpret_cast<const char*>(bytes.data()), std::streamsize(bytes.size()));
  EXPECT_EQ(store->get(key(1)), nullptr);
  EXPECT_EQ(store->stats().damaged, 0u);
  ASSERT_TRUE(store->put(key(1), *makeTerm(1, 50)).ok());
  ASSERT_NE(store->get(key(1)), nullptr);
}

TEST(StoreTrust, AFolderThatOthersCanWriteToIsRefused) {
  TempFolder folder;
  const std::string cache = folder.path + "/cache";
  ::mkdir(cache.c_str(), 0700);
  ::chmod(cache.c_str(), 0777);
  const Status open = DiskStore::open(cache, 1 << 20).status();
  EXPECT_EQ(open.code(), Code::FailedPrecondition) << open.toString();
  EXPECT_NE(open.toString().find(cache), std::string::npos);
  EXPECT_NE(open.message().find("chmod 0700"), std::string::npos) << open.toString();
}

/// A render that keeps terms on disk: dear enough for them to go there.
v1::RenderRequest dearRequest(uint64_t seed) {
  v1::RenderRequest r = smallRequest("cornell", 24, 16, 16);
  r.set_seed(seed);
  return r;
}

TEST(StoreTrust, RendersGoOnWithoutTheirFolder) {
  TempFolder folder;
  const std::string cache = folder.path + "/cache";
  const auto engine = makeEngine(1 << 20, cache);
  mustRender(*engine, dearRequest(1));
  ASSERT_GT(termFiles(cache).count, 0u);
  const auto check = [&](const char* what, uint64_t seed) {
    EXPECT_EQ(firstDifference(mustRender(*engine, dearRequest(1)), mustRender(*makeEngine(), dearRequest(1))), "") << what;
    EXPECT_EQ(firstDifference(mustRender(*engine, dearRequest(seed)), mustRender(*makeEngine(), dearRequest(seed))), "") << what;
  };
  fs::remove_all(cache);
  check("deleted", 2);
  EXPECT_GT(termFiles(cache).count, 0u) << "made again";
  struct stat info {};
  ASSERT_EQ(::stat(cache.c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 07777, 0700u);
  fs::remove_all(cache);
  std::ofstream(cache) << "a file in its place";
  check("a file in its place", 3);
  fs::remove(cache);
  ::mkdir((folder.path + "/theirs").c_str(), 0700);
  ::chmod((folder.path + "/theirs").c_str(), 0777);
  fs::create_symlink(folder.path + "/theirs", cache);  // not made again: it is there, and must not be believed either
  check("another's in its place", 4);
}

TEST(StoreTrust, RendersGoOnOnAFullOrReadOnlyDisk) {
  TempFolder folder;
  const std::string mount = folder.path + "/small";
  ::mkdir(mount.c_str(), 0700);
  if (::mount("none", mount.c_str(), "tmpfs", 0, "size=256k,mode=0700") != 0) GTEST_SKIP() << "mount is not permitted here";
  struct Unmount {
    std::string path;
    ~Unmount() {
      while (::umount2(path.c_str(), MNT_DETACH) == 0) {}
    }
  } unmount{mount};
  const auto engine = makeEngine(1 << 20, mount + "/cache");
  const auto check = [&](const char* what, uint64_t seed) {
    EXPECT_EQ(firstDifference(mustRender(*engine, dearRequest(seed)), mustRender(*makeEngine(), dearRequest(seed))), "") << what << seed;
  };
  check("room", 1);
  EXPECT_GT(termFiles(mount).count, 0u);
  std::ofstream(mount + "/filler", std::ios::binary) << std::string(400 << 10, 'x');  // what fits
  check("full", 2);
  check("full", 1);
  // Read-only for whoever comes by its name: the store holds open files, which rule out a plain remount.
  ASSERT_EQ(::mount(mount.c_str(), mount.c_str(), nullptr, MS_BIND, nullptr), 0);
  ASSERT_EQ(::mount(nullptr, mount.c_str(), nullptr, MS_REMOUNT | MS_BIND | MS_RDONLY, nullptr), 0);
  check("read-only", 3);
  check("read-only", 1);
  const Status open = DiskStore::open(mount + "/cache", 1 << 20).status();  // at a start: not usable, but not distrusted
  EXPECT_FALSE(open.ok());
  EXPECT_NE(open.code(), Code::FailedPrecondition) << open.toString();
}

TEST(StoreTrust, AClockThatJumpsByTenYearsChangesNoTermAndKeepsTheOrderOfUse) {
  TempFolder folder;
  constexpr int64_t kTenYears = 10ll * 365 * 86400 * 1000000;
  int64_t now = 1700000000ll * 1000000;
  const uint64_t one = serializeTerm(*makeTerm(0, 1000), key(0)).size();
  DiskStoreOptions options;
  options.maxBytes = 4 * one + 100;
  options.nowMicros = [&] { return now += 1000; };
  auto store = std::move(*DiskStore::open(folder.path, options));
  std::vector<int> used;  // latest last
  const auto use = [&](int i) {
    std::erase(used, i);
    used.push_back(i);
    if (used.size() > 4) used.erase(used.begin());
  };
  int next = 0;
  for (const int64_t jump : {int64_t(0), kTenYears, -kTenYears, -kTenYears, 2 * kTenYears}) {
    for (const bool restart : {false, true}) {
      now += restart ? 0 : jump;
      if (restart) store = nullptr, store = std::move(*DiskStore::open(folder.path, options));
      for (int k = 0; k < 3; ++k, ++next) {
        ASSERT_TRUE(store->put(key(next), *makeTerm(next, 1000)).ok());
        use(next);
        if (used.size() < 2) continue;
        const int again = used[used.size() / 2 - 1];
        const TermPtr term = store->get(key(again));
        ASSERT_NE(term, nullptr) << again << " went though it was not the least recently used, jump " << jump;
        EXPECT_EQ(term->content(), makeTerm(again, 1000)->content());
        use(again);
      }
      for (const int i : used) EXPECT_NE(store->get(key(i)), nullptr) << i << " jump " << jump << " restart " << restart;
      for (const int i : std::vector<int>(used)) use(i);
    }
  }
}

}  // namespace
}  // namespace gobo::testing

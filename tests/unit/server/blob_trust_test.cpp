// SPDX-License-Identifier: Apache-2.0
// The blob cache as a thing that fails: bytes that change on the disk, a folder that goes, fills up, becomes read-only or is somebody
// else's. A load then costs time; it neither fails nor gives another scene.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <random>
#include <thread>

#include "base/descriptor.h"
#include "import/load.h"
#include "plan/engine.h"
#include "server/blob_cache.h"
#include "server/ingest_loader.h"
#include "server/log.h"
#include "server/server.h"
#include "support/blob_bytes.h"
#include "support/instrumented.h"
#include "support/small_gltf.h"

namespace gobo::blob_trust_test {
namespace {

namespace fs = std::filesystem;

struct BlobTrustTest : ::testing::Test {
  std::string folder;
  void SetUp() override {
    setLogLevel(LogLevel::Off);
    std::string pattern = (fs::temp_directory_path() / "gobo-blob-XXXXXX").string();
    ASSERT_NE(::mkdtemp(pattern.data()), nullptr);
    folder = pattern;
    std::ofstream(folder + "/scene.gltf", std::ios::binary) << smallGltf("paint.png");
    std::ofstream(folder + "/paint.png", std::ios::binary) << smallPng(200, 40, 90);
    const auto direct = loadGltf(folder + "/scene.gltf");
    ASSERT_TRUE(direct.ok()) << direct.status().toString();
    expected = *direct;
  }
  void TearDown() override { fs::remove_all(folder); }
  std::shared_ptr<SceneLoader> loader(const std::string& cache) const {
    IngestOptions o;
    o.cacheFolder = cache;
    auto made = childLoader(o);
    EXPECT_TRUE(made.ok()) << made.status().toString();
    return made.ok() ? *made : nullptr;
  }
  /// Loads the scene, which must be the right one, texels and vertices included. Whether it came from the cache.
  bool loads(SceneLoader& loading, const char* what) const {
    const auto loaded = loading.scene(folder + "/scene.gltf", {});
    EXPECT_TRUE(loaded.ok()) << what << ": " << loaded.status().toString();
    if (!loaded.ok()) return false;
    EXPECT_EQ(loaded->scene->hash(), expected->hash()) << what;
    EXPECT_EQ(blobOf(*loaded->scene).bytes, blobOf(*expected).bytes) << what;
    return loaded->report.cached;
  }
  static std::string blobIn(const std::string& cache) {
    for (const auto& e : fs::directory_iterator(cache))
      if (e.path().extension() == ".blob") return e.path().string();
    return {};
  }
  static void flip(const std::string& path, size_t at, uint8_t bits) {
    const int fd = ::open(path.c_str(), O_RDWR);
    uint8_t b = 0;
    ASSERT_EQ(::pread(fd, &b, 1, off_t(at)), 1);
    b ^= bits;
    ASSERT_EQ(::pwrite(fd, &b, 1, off_t(at)), 1);
    ::close(fd);
  }
  ScenePtr expected;
};

TEST_F(BlobTrustTest, AByteThatChangesOnTheDiskIsNeverServed) {
  const auto loading = loader(folder + "/cache");
  EXPECT_FALSE(loads(*loading, "first"));
  EXPECT_TRUE(loads(*loading, "second"));
  std::mt19937 random(5);
  for (int k = 0; k < (testing::kInstrumented ? 7 : 14); ++k) {
    const std::string blob = blobIn(folder + "/cache");
    ASSERT_FALSE(blob.empty());
    const size_t size = fs::file_size(blob), at = k < 6 ? size - 1 - size_t(k) * size / 8 : random() % size;
    flip(blob, at, uint8_t(1u << random() % 8));
    EXPECT_FALSE(loads(*loading, ("byte " + std::to_string(at)).c_str())) << at;
    EXPECT_TRUE(loads(*loading, "made anew"));
  }
}

TEST_F(BlobTrustTest, WhatWasCheckedIsNotCheckedAgainUntilTheFileChanges) {
  const auto cache = std::move(*BlobCache::open(folder + "/cache", 1 << 30));
  const BlobKey key{1, 2, 3};
  const BlobBytes blob = blobOf(*expected);
  auto temporary = std::move(*cache->begin());
  ASSERT_EQ(::write(temporary->fd(), blob.bytes.data(), blob.bytes.size()), ssize_t(blob.bytes.size()));
  ASSERT_TRUE(cache->commit(*temporary, key).ok());
  const auto found = [&] {
    const auto r = cache->find(key);
    return r.ok() && *r;
  };
  EXPECT_TRUE(found());
  EXPECT_TRUE(found());
  EXPECT_EQ(cache->checks(), 2u);  // written a moment ago: its stamp says nothing yet
  std::this_thread::sleep_for(std::chrono::milliseconds(2050));
  EXPECT_TRUE(found());
  EXPECT_EQ(cache->checks(), 3u);
  for (int k = 0; k < 3; ++k) EXPECT_TRUE(found());
  EXPECT_EQ(cache->checks(), 3u);
  const std::string path = blobIn(folder + "/cache");
  struct stat before {};
  ASSERT_EQ(::stat(path.c_str(), &before), 0);
  flip(path, blob.bytes.size() - 70, 1);
  const timespec times[2] = {before.st_atim, before.st_mtim};  // mtime set back: ctime tells
  ASSERT_EQ(::utimensat(AT_FDCWD, path.c_str(), times, 0), 0);
  EXPECT_EQ(cache->find(key).status().code(), Code::DataLoss);
  StopSource stop;
  stop.stop(StopReason::Cancelled);
  EXPECT_EQ(cache->find(key, stop.token()).status().code(), Code::Cancelled);
  cache->remove(key);
  EXPECT_FALSE(found());
  EXPECT_TRUE(fs::is_empty(folder + "/cache")) << "its .used is left";
}

TEST_F(BlobTrustTest, UnfinishedBlobsOfDaemonsWithTheSameNumberStay) {
  const std::string cache = folder + "/cache";
  const auto mine = std::move(*BlobCache::open(cache, 1 << 30));
  // As earlier builds name them, of a daemon in another container whose process has this one's number.
  std::vector<std::pair<std::string, Descriptor>> theirs;
  for (int i = 0; i < 256; ++i) {
    const std::string path = cache + "/.tmp-" + std::to_string(::getpid()) + "-" + std::to_string(i);
    theirs.emplace_back(path, Descriptor(::open(path.c_str(), O_CREAT | O_EXCL | O_RDWR | O_CLOEXEC, 0600)));
    ASSERT_EQ(::flock(theirs.back().second.get(), LOCK_EX | LOCK_NB), 0);
  }
  const auto another = std::move(*BlobCache::open(cache, 1 << 30));  // one that starts meanwhile
  const BlobBytes blob = blobOf(*expected);
  for (uint8_t i = 0; i < 3; ++i) {
    auto temporary = mine->begin(), beside = another->begin();
    ASSERT_TRUE(temporary.ok() && beside.ok()) << temporary.status().toString() << beside.status().toString();
    ASSERT_EQ(::write((*temporary)->fd(), blob.bytes.data(), blob.bytes.size()), ssize_t(blob.bytes.size()));
    ASSERT_TRUE(mine->commit(**temporary, BlobKey{i}).ok());
    const auto found = another->find(BlobKey{i});
    EXPECT_TRUE(found.ok() && *found) << int(i);
  }
  for (const auto& [path, fd] : theirs) EXPECT_TRUE(fs::exists(path)) << path;
}

TEST_F(BlobTrustTest, TheLeastRecentlyUsedGoesThoughUseDoesNotTouchTheBlob) {
  const BlobBytes blob = blobOf(*expected);
  const auto cache = std::move(*BlobCache::open(folder + "/cache", 2 * blob.bytes.size() + 100));
  const auto keyOf = [](int i) { return BlobKey{uint8_t(i)}; };
  const auto put = [&](int i) {
    auto temporary = std::move(*cache->begin());
    ASSERT_EQ(::write(temporary->fd(), blob.bytes.data(), blob.bytes.size()), ssize_t(blob.bytes.size()));
    ASSERT_TRUE(cache->commit(*temporary, keyOf(i)).ok());
    std::this_thread::sleep_for(std::chrono::milliseconds(20));  // ticks of the file system's clock
  };
  const auto has = [&](int i) { return *cache->find(keyOf(i)) != nullptr; };
  put(1);
  put(2);
  EXPECT_TRUE(has(1));
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  put(3);
  EXPECT_FALSE(has(2));
  EXPECT_TRUE(has(1));
  EXPECT_TRUE(has(3));
}

TEST_F(BlobTrustTest, LoadsGoOnWithoutTheFolder) {
  const std::string cache = folder + "/cache";
  const auto loading = loader(cache);
  loads(*loading, "first");
  EXPECT_TRUE(loads(*loading, "second"));
  fs::remove_all(cache);
  EXPECT_FALSE(loads(*loading, "deleted"));
  struct stat info {};
  ASSERT_EQ(::stat(cache.c_str(), &info), 0) << "made again";
  EXPECT_EQ(info.st_mode & 07777, 0700u);
  EXPECT_TRUE(loads(*loading, "kept again"));
  fs::remove_all(cache);
  std::ofstream(cache) << "a file in its place";
  EXPECT_FALSE(loads(*loading, "a file in its place"));
  fs::remove(cache);
  EXPECT_FALSE(loads(*loading, "gone again"));
  EXPECT_TRUE(loads(*loading, "kept at last"));
}

TEST_F(BlobTrustTest, LoadsGoOnOnAFullOrReadOnlyDisk) {
  const std::string mount = folder + "/small";
  ::mkdir(mount.c_str(), 0700);
  if (::mount("none", mount.c_str(), "tmpfs", 0, "size=64k,mode=0700") != 0) GTEST_SKIP() << "mount is not permitted here";
  struct Unmount {
    std::string path;
    ~Unmount() { ::umount2(path.c_str(), MNT_DETACH); }
  } unmount{mount};
  const std::string cache = mount + "/cache";
  const auto loading = loader(cache);
  std::ofstream(mount + "/filler", std::ios::binary) << std::string(200 << 10, 'x');  // what fits
  ASSERT_LT(fs::file_size(mount + "/filler"), uintmax_t(200 << 10));
  for (int k = 0; k < 2; ++k) EXPECT_FALSE(loads(*loading, "full"));
  EXPECT_EQ(blobIn(cache), "");
  for (const auto& e : fs::directory_iterator(cache)) ADD_FAILURE() << "left behind: " << e.path();
  fs::remove(mount + "/filler");
  EXPECT_FALSE(loads(*loading, "room again"));
  EXPECT_TRUE(loads(*loading, "kept"));
  ASSERT_EQ(::mount("none", mount.c_str(), "tmpfs", MS_REMOUNT | MS_RDONLY, nullptr), 0);
  EXPECT_TRUE(loads(*loading, "read-only, kept before"));
  std::ofstream(folder + "/paint.png", std::ios::binary) << smallPng(10, 20, 30);
  expected = *loadGltf(folder + "/scene.gltf");
  EXPECT_FALSE(loads(*loading, "read-only, another"));
  EXPECT_TRUE(loader(cache) != nullptr) << "at a start";
}

TEST_F(BlobTrustTest, ADaemonStartsWithoutCachesThatCannotBeWrittenButNotWithThoseOfOthers) {
  ServerConfig config;
  config.threads = 1;
  config.cacheFolder = "/proc/gobo-cache";
  config.ingestCacheFolder = "/proc/gobo-cache/ingest";
  const auto started = Server::start(config, engineOptions(config), false);
  ASSERT_TRUE(started.ok()) << started.status().toString();
  const std::string open = folder + "/open";
  ::mkdir(open.c_str(), 0700);
  ::chmod(open.c_str(), 0777);
  for (int k = 0; k < 3; ++k) {
    ServerConfig c;
    c.threads = 1;
    (k == 0 ? c.cacheFolder : k == 1 ? c.ingestCacheFolder : c.jobsFolder) = open;
    const Status refused = Server::start(c, engineOptions(c), false).status();
    EXPECT_EQ(refused.code(), Code::FailedPrecondition) << k << ": " << refused.toString();
    EXPECT_NE(refused.toString().find(open), std::string::npos) << refused.toString();
    EXPECT_NE(refused.message().find("chmod 0700"), std::string::npos) << refused.toString();
  }
}

TEST_F(BlobTrustTest, CostOfTheCheck) {
  Environment map;
  map.width = 4096;
  map.height = 2048;
  map.texels.assign(size_t(map.width) * size_t(map.height), Vec3(0.25f));
  map.content = environmentDigest(map);
  const BlobBytes blob = blobOf(map);
  const auto [owner, view] = blob.aligned();
  double best = 1e9;
  for (int k = 0; k < 5; ++k) {
    const auto from = std::chrono::steady_clock::now();
    ASSERT_TRUE(checkBlobArrays(view).ok());
    best = std::min(best, std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - from).count());
  }
  std::cout << "  check of arrays: " << best * 1e8 / double(view.size()) << " ms per 100 MB (in memory, best of 5)\n";
}

}  // namespace
}  // namespace gobo::blob_trust_test

// SPDX-License-Identifier: Apache-2.0
// Real children of the real gobo-ingest: what the sandbox stops, what each limit is called, that a blob is the scene, that the
// cache gives back what was put in and never what is stale.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>

#include "import/load.h"
#include "plan/engine.h"
#include "server/blob_cache.h"
#include "server/ingest_child.h"
#include "server/ingest_loader.h"
#include "server/log.h"
#include "support/small_gltf.h"

namespace gobo::ingest_test {
namespace {

namespace fs = std::filesystem;

// Of the probe that spins: the thread sanitizer alone needs about one to start a process. The others are not hurried.
#ifdef GOBO_THREAD_SANITIZER
constexpr uint32_t kCpuSeconds = 10;
#else
constexpr uint32_t kCpuSeconds = 1;
#endif

class Ingest : public ::testing::Test {
 protected:
  void SetUp() override {
    setLogLevel(LogLevel::Off);
    std::string pattern = (fs::temp_directory_path() / "gobo-ingest-XXXXXX").string();
    ASSERT_NE(::mkdtemp(pattern.data()), nullptr);
    folder = pattern;
    ASSERT_FALSE(findIngestProgram().empty()) << "gobo-ingest is not built";
  }
  void TearDown() override { fs::remove_all(folder); }

  Status probe(const std::string& what, double wall = 60, const StopToken& stop = {}) {
    const int out = ::memfd_create("probe", MFD_CLOEXEC);
    ingest::Job job{ingest::Task::Probe, what, 1 << 20, 1 << 30, 1 << 30, 256ull << 20, 8 << 20, what == "spin" ? kCpuSeconds : 30};
    const auto result = runIngest(*forkedReaders(findIngestProgram()), job, out, wall, stop);
    written = ::lseek(out, 0, SEEK_END);
    ::close(out);
    return result.ok() ? Status() : result.status();
  }
  IngestOptions options(bool cache = true) const {
    IngestOptions o;
    if (cache) o.cacheFolder = folder + "/cache";
    return o;
  }
  std::shared_ptr<SceneLoader> loader(const IngestOptions& o) {
    auto made = childLoader(o);
    EXPECT_TRUE(made.ok()) << made.status().toString();
    return *made;
  }
  std::string put(const std::string& name, const std::string& text) {
    std::ofstream(folder + "/" + name, std::ios::binary) << text;
    return folder + "/" + name;
  }
  /// As if the file had been there for long: its stamp may be trusted.
  static void settle() { std::this_thread::sleep_for(std::chrono::milliseconds(2050)); }
  size_t blobs() const {
    size_t n = 0;
    for (const auto& e : fs::directory_iterator(folder + "/cache")) n += e.path().extension() == ".blob";
    return n;
  }
  std::string folder;
  int64_t written = 0;
};

TEST_F(Ingest, SandboxDeniesWhatParsersNeverNeed) {
  for (const char* what : {"open", "create", "fork", "thread"}) {
    const Status s = probe(what);
    EXPECT_EQ(s.code(), Code::FailedPrecondition) << what << ": " << s.toString();
    EXPECT_NE(s.message().find("was denied"), std::string::npos) << s.toString();
  }
  for (const char* what : {"socket", "exec", "kill", "ptrace", "mmap-exec", "descriptor"}) {
    const Status s = probe(what);
    EXPECT_EQ(s.code(), Code::Internal) << what;
    EXPECT_NE(s.message().find("system call that its sandbox forbids"), std::string::npos) << what << ": " << s.toString();
  }
}

TEST_F(Ingest, EveryEndOfAChildHasItsName) {
  const auto expect = [&](const char* what, Code code, const char* text, double wall = 60) {
    const Status s = probe(what, wall);
    EXPECT_EQ(s.code(), code) << what << ": " << s.toString();
    EXPECT_NE(s.message().find(text), std::string::npos) << what << ": " << s.toString();
    EXPECT_EQ(s.location(), what);  // the file that was being read
    std::cout << "  " << what << ": " << s.toString() << "\n";
  };
  expect("segv", Code::InvalidArgument, "crashes its reader (Segmentation fault, SIGSEGV)");
  expect("abort", Code::InvalidArgument, "crashes its reader (Aborted, SIGABRT)");
  expect("spin", Code::ResourceExhausted, ("more than " + std::to_string(kCpuSeconds) + " s of CPU time (ingest.cpu_s)").c_str());
  expect("sleep", Code::ResourceExhausted, "longer than 0.3 s (ingest.wall_s)", 0.3);
#if !defined(__SANITIZE_ADDRESS__) && !defined(GOBO_THREAD_SANITIZER)  // whose shadow memory rules out the limit
  expect("allocate", Code::ResourceExhausted, "more memory than 268435456 bytes (ingest.memory_bytes)");
#endif
  expect("write", Code::ResourceExhausted, "larger than 8388608 bytes (ingest.blob_bytes)");
  EXPECT_LE(written, 8 << 20);
  expect("silent", Code::Internal, "left without an answer");
  expect("babble", Code::Internal, "broke the protocol");
}

TEST_F(Ingest, StopKillsTheChild) {
  StopSource stop;
  std::thread later([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    stop.stop(StopReason::Cancelled);
  });
  const auto start = std::chrono::steady_clock::now();
  EXPECT_EQ(probe("sleep", 60, stop.token()).code(), Code::Cancelled);
  later.join();
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(20));
}

TEST_F(Ingest, ProgramThatIsNotThereIsAnError) {
  IngestOptions o = options();
  o.program = "/no/such/gobo-ingest";
  const auto made = childLoader(o);
  EXPECT_EQ(made.status().code(), Code::FailedPrecondition);
  EXPECT_NE(made.status().message().find("ingest.program"), std::string::npos);
}

TEST_F(Ingest, BlobIsTheScene) {
  const std::string path = put("scene.gltf", smallGltf("paint.png"));
  put("paint.png", smallPng(200, 40, 90));
  const auto direct = loadGltf(path);
  ASSERT_TRUE(direct.ok()) << direct.status().toString();
  for (const bool cache : {false, true}) {
    const auto loading = loader(options(cache));
    for (int k = 0; k < 2; ++k) {
      const auto loaded = loading->scene(path, {});
      ASSERT_TRUE(loaded.ok()) << loaded.status().toString();
      EXPECT_EQ(loaded->scene->hash(), (*direct)->hash());
      EXPECT_EQ(loaded->scene->warnings, (*direct)->warnings);
      ASSERT_EQ(loaded->scene->textures.size(), 1u);
      EXPECT_EQ(loaded->scene->textures[0]->texels8, (*direct)->textures[0]->texels8);
      EXPECT_EQ(loaded->report.cached, cache && k == 1);
      EXPECT_GT(loaded->report.blobBytes, 0u);
      EXPECT_EQ(loaded->report.ingestMs > 0, !(cache && k == 1));
    }
  }
}

TEST_F(Ingest, PicturesAreTheSameBits) {
  const std::string path = put("scene.gltf", smallGltf("paint.png"));
  put("paint.png", smallPng(200, 40, 90));
  v1::RenderRequest request;
  request.set_width(48);
  request.set_height(32);
  request.mutable_halt()->set_spp(4);
  std::vector<std::vector<float>> pictures;
  for (int k = 0; k < 3; ++k) {  // in this process, by a child, from the cache
    EngineOptions o;
    o.threads = 2;
    o.anyPath = true;
    o.loader = k > 0 ? std::shared_ptr<SceneLoader>(loader(options())) : inProcessLoader();
    auto engine = Engine::create(o);
    ASSERT_TRUE(engine.ok());
    const auto info = (*engine)->openScene(path, "s");
    ASSERT_TRUE(info.ok()) << info.status().toString();
    EXPECT_EQ(info->blob_cached(), k == 2);
    request.set_scene("s");
    const auto result = (*engine)->render(request);
    ASSERT_TRUE(result.ok()) << result.status().toString();
    const auto pixels = result->images[0].pixels();
    pictures.emplace_back(pixels.begin(), pixels.end());
    EXPECT_GT((*engine)->inspectScene("s")->bvh_ms(), 0.0);
  }
  EXPECT_EQ(pictures[0], pictures[1]);
  EXPECT_EQ(pictures[0], pictures[2]);
  float sum = 0;
  for (const float v : pictures[0]) sum += v;
  EXPECT_GT(sum, 0.0f);
}

TEST_F(Ingest, NothingStaleIsGivenBack) {
  const std::string path = put("scene.gltf", smallGltf("paint.png"));
  put("paint.png", smallPng(200, 40, 90));
  const auto loading = loader(options());
  const auto load = [&](bool cached) {
    const auto loaded = loading->scene(path, {});
    EXPECT_TRUE(loaded.ok()) << loaded.status().toString();
    EXPECT_EQ(loaded->report.cached, cached);
    return loaded->scene->hash();
  };
  const Hash128 red = load(false);
  settle();
  EXPECT_EQ(load(true), red);  // hashes the files; their stamps are trusted from now on
  EXPECT_EQ(load(true), red);
  // A change of the side file alone, of the same size, with its modification time set back.
  struct stat before {};
  ASSERT_EQ(::stat((folder + "/paint.png").c_str(), &before), 0);
  put("paint.png", smallPng(20, 240, 90));
  const timespec times[2] = {before.st_atim, before.st_mtim};
  ASSERT_EQ(::utimensat(AT_FDCWD, (folder + "/paint.png").c_str(), times, 0), 0);
  struct stat after {};
  ::stat((folder + "/paint.png").c_str(), &after);
  ASSERT_EQ(after.st_size, before.st_size);
  ASSERT_EQ(after.st_mtim.tv_nsec, before.st_mtim.tv_nsec);
  const Hash128 green = load(false);
  EXPECT_NE(green, red);
  put("paint.png", smallPng(200, 40, 90));  // what was there first is known
  EXPECT_EQ(load(true), red);
  // Two changes within one tick of the clock: an unsettled stamp is not trusted.
  for (int k = 0; k < 3; ++k) {
    put("paint.png", smallPng(uint8_t(k), 0, 0));
    load(false);
    put("paint.png", smallPng(uint8_t(k + 100), 0, 0));
    load(false);
  }
  // A side file that goes away, and comes.
  fs::remove(folder + "/paint.png");
  const auto without = loading->scene(path, {});
  ASSERT_TRUE(without.ok());
  EXPECT_FALSE(without->report.cached);
  EXPECT_EQ(without->scene->textures.size(), 0u);
  EXPECT_TRUE(loading->scene(path, {})->report.cached);
  put("paint.png", smallPng(200, 40, 90));
  EXPECT_EQ(load(true), red);
}

TEST_F(Ingest, AnotherDaemonAndAnotherFolderFindTheBlob) {
  const std::string path = put("scene.gltf", smallGltf(""));
  EXPECT_FALSE(loader(options())->scene(path, {})->report.cached);
  EXPECT_TRUE(loader(options())->scene(path, {})->report.cached);
  fs::create_directory(folder + "/elsewhere");
  fs::copy(path, folder + "/elsewhere/scene.gltf");
  EXPECT_TRUE(loader(options())->scene(folder + "/elsewhere/scene.gltf", {})->report.cached);
  IngestOptions other = options();
  other.textureBytes = 1 << 20;  // an option that the result depends on
  EXPECT_FALSE(loader(other)->scene(path, {})->report.cached);
}

TEST_F(Ingest, DamagedBlobIsMadeAgain) {
  const std::string path = put("scene.gltf", smallGltf(""));
  const auto loading = loader(options());
  const Hash128 hash = loading->scene(path, {})->scene->hash();
  for (const auto& damage : {std::function<void(const std::string&)>([](const std::string& f) { fs::resize_file(f, 100); }),
                             std::function<void(const std::string&)>([](const std::string& f) { fs::resize_file(f, fs::file_size(f) - 64); }),
                             std::function<void(const std::string&)>([](const std::string& f) {
                               std::fstream s(f, std::ios::in | std::ios::out | std::ios::binary);
                               s.seekp(140);
                               s.put('\x7f');
                             }),
                             std::function<void(const std::string&)>([](const std::string& f) { std::ofstream(f, std::ios::trunc); })}) {
    for (const auto& e : fs::directory_iterator(folder + "/cache"))
      if (e.path().extension() == ".blob") damage(e.path());
    const auto again = loading->scene(path, {});
    ASSERT_TRUE(again.ok()) << again.status().toString();
    EXPECT_FALSE(again->report.cached);
    EXPECT_EQ(again->scene->hash(), hash);
    EXPECT_TRUE(loading->scene(path, {})->report.cached);
  }
}

TEST_F(Ingest, CacheIsBoundedAndScenesOutliveTheirBlobs) {
  IngestOptions o = options();
  o.cacheBytes = 1;
  const auto loading = loader(o);
  const auto a = loading->scene(put("a.gltf", smallGltf("")), {});
  ASSERT_TRUE(a.ok());
  EXPECT_EQ(blobs(), 1u);  // the newest is kept
  const auto b = loading->scene(put("b.gltf", smallGltf("")), {});
  ASSERT_TRUE(b.ok());
  EXPECT_EQ(blobs(), 1u);
  EXPECT_EQ(blobOfScene(*a->scene), blobOfScene(*loadGltf(folder + "/a.gltf").value()));  // mapped, though its name is gone
}

TEST_F(Ingest, FolderOfOthersIsNotTrusted) {
  fs::create_directory(folder + "/cache");
  ::chmod((folder + "/cache").c_str(), 0777);
  const auto made = childLoader(options());
  EXPECT_EQ(made.status().code(), Code::FailedPrecondition) << made.status().toString();
}

TEST_F(Ingest, TemporariesOfTheDeadAreRemovedThoseOfTheLivingAreNot) {
  auto cache = BlobCache::open(folder + "/cache", 1 << 30);
  ASSERT_TRUE(cache.ok());
  put("cache/.tmp-1-0", "left by a killed daemon");
  auto living = (*cache)->begin();
  ASSERT_TRUE(living.ok());
  ASSERT_TRUE(BlobCache::open(folder + "/cache", 1 << 30).ok());
  EXPECT_FALSE(fs::exists(folder + "/cache/.tmp-1-0"));
  size_t left = 0;
  for (const auto& e : fs::directory_iterator(folder + "/cache")) left += e.path().filename().string().rfind(".tmp-", 0) == 0;
  EXPECT_EQ(left, 1u);
  living->reset();
  for (const auto& e : fs::directory_iterator(folder + "/cache")) EXPECT_NE(e.path().filename().string().rfind(".tmp-", 0), 0u);
}

TEST_F(Ingest, EnvironmentsToo) {
  const std::string file = fs::absolute("../shared/data/hdr/hdrify/example_zip.exr").lexically_normal().string();
  if (!fs::exists(file)) GTEST_SKIP() << "../shared/data is absent";
  const auto direct = loadEnvironment(file);
  const auto loading = loader(options());
  for (int k = 0; k < 2; ++k) {
    const auto map = loading->environment(file, {});
    ASSERT_TRUE(map.ok()) << map.status().toString();
    EXPECT_EQ((*map)->content, (*direct)->content);
    EXPECT_EQ((*map)->name, (*direct)->name);
  }
  EXPECT_EQ(blobs(), 1u);
}

}  // namespace
}  // namespace gobo::ingest_test

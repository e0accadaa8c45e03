// SPDX-License-Identifier: Apache-2.0
// Blobs that lose their bytes while they are mapped (SIGBUS): the render says which file and scene, nothing that was made of the zeroes
// leaves or is kept, and the next load gives the right picture, from a blob made anew. What the cases truncate stands for a bad sector too.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <filesystem>
#include <fstream>
#include <thread>

#include "base/mapped_file.h"
#include "import/load.h"
#include "scene/scene.h"
#include "server/ingest_loader.h"
#include "server/log.h"
#include "support/engines.h"
#include "support/instrumented.h"
#include "support/small_gltf.h"
#include "support/thorough.h"

namespace gobo::testing {
namespace {

namespace fs = std::filesystem;
// Samples: some tenths of a second, so that the cut comes in the middle.
constexpr int kLong = asLong(1024);

struct BrokenBlob : ::testing::Test {
  std::string folder, file, map;
  std::unique_ptr<Engine> engine;

  void SetUp() override {
    setLogLevel(LogLevel::Off);
    std::string pattern = (fs::temp_directory_path() / "gobo-broken-XXXXXX").string();
    ASSERT_NE(::mkdtemp(pattern.data()), nullptr);
    folder = pattern;
    file = folder + "/scene.gltf";
    map = folder + "/sky.exr";
    std::ofstream(file, std::ios::binary) << smallGltf("paint.png");
    Image paint(128, 128, 3), sky(64, 32, 3);  // of many pages
    for (size_t i = 0; i < paint.data.size(); ++i) paint.data[i] = float(i * 7919 % 251) / 250.0f;
    for (size_t i = 0; i < sky.data.size(); ++i) sky.data[i] = 0.1f + float(i * 7919 % 251) / 250.0f;
    put(folder + "/paint.png", *encodePng(paint));
    put(map, *encodeExr(sky));
    engine = start();
  }
  void TearDown() override { fs::remove_all(folder); }
  static void put(const std::string& path, const std::vector<uint8_t>& bytes) {
    std::ofstream(path, std::ios::binary).write(reinterpret_cast<const char*>(bytes.data()), std::streamsize(bytes.size()));
  }
  /// `kept`: with the blobs and terms that earlier ones have left on the disk.
  std::unique_ptr<Engine> start(bool kept = true) const {
    IngestOptions ingest;
    if (kept) ingest.cacheFolder = folder + "/blobs";
    EngineOptions o;
    o.loader = inProcessLoader();
    o.threads = 2;
    o.storeBytes = 256ull << 20;
    if (kept) o.cacheFolder = folder + "/terms";
    o.anyPath = true;
    o.loader = *childLoader(ingest);
    return *Engine::create(o);
  }
  void open(Engine& e, const std::string& id = "scene") const {
    const auto info = e.openScene(file, id);
    ASSERT_TRUE(info.ok()) << info.status().toString();
  }
  v1::RenderRequest request(uint64_t seed = 0, int spp = 64) const {
    v1::RenderRequest r = smallRequest("scene", 24, 16, spp);
    r.set_seed(seed);
    set(r, "camera.position=0,0,2.5");
    set(r, "camera.look_at=0,0,0");
    return r;
  }
  v1::RenderRequest lit(uint64_t seed) const {
    v1::RenderRequest r = request(seed);
    r.mutable_environment()->set_path(map);
    return r;
  }
  /// As an engine that keeps nothing and is left in peace renders it.
  void expectRight(Engine& e, const v1::RenderRequest& r, const char* what) const {
    const auto peace = start(false);
    open(*peace);
    EXPECT_EQ(firstDifference(mustRender(e, r), mustRender(*peace, r)), "") << what;
  }
  std::vector<std::string> blobs() const {
    std::vector<std::string> out;
    for (const auto& e : fs::directory_iterator(folder + "/blobs"))
      if (e.path().extension() == ".blob") out.push_back(e.path().string());
    return out;
  }
  void cut(const std::string& blob, double part) const { ASSERT_EQ(::truncate(blob.c_str(), off_t(double(fs::file_size(blob)) * part)), 0); }
  static void expectLost(const Status& s, const std::string& blob, const std::string& what) {
    EXPECT_EQ(s.code(), Code::DataLoss) << s.toString();
    EXPECT_NE(s.message().find(blob), std::string::npos) << s.toString();
    EXPECT_NE(s.message().find(what), std::string::npos) << s.toString();
  }
};

TEST_F(BrokenBlob, CutWhileNothingRuns) {
  uint64_t seed = 0;
  for (const bool cached : {false, true})  // mapped when it was made, or found
    for (const double part : {0.0, 0.3, 0.999}) {
      SCOPED_TRACE(std::to_string(part));
      if (cached) engine = start();
      open(*engine);
      expectRight(*engine, request(++seed), "before");  // its acceleration structure looks into the mapping
      ASSERT_EQ(blobs().size(), 1u);
      const std::string blob = blobs()[0];
      cut(blob, part);
      expectLost(engine->render(request(++seed)).status(), blob, "scene 'scene'");
      EXPECT_TRUE(blobs().empty()) << "it is not found again";
      const Status gone = engine->render(request(seed)).status();
      EXPECT_EQ(gone.code(), Code::NotFound);
      EXPECT_NE(gone.message().find("mapped file was cut short"), std::string::npos) << gone.toString();
      open(*engine);
      expectRight(*engine, request(seed), "loaded again");
      EXPECT_EQ(blobs().size(), 1u);
    }
}

// The first half of the samples is right, the second is made of zeroes: no term of it may be found by the next render, here or on the disk.
TEST_F(BrokenBlob, CutWhileItRenders) {
  for (const double part : {0.0, 0.3, 0.999}) {
    const uint64_t seed = uint64_t(part * 1000) + 1;
    open(*engine);
    const std::string blob = blobs().at(0);
    std::thread later([&] {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      cut(blob, part);
    });
    const auto result = engine->render(request(seed, kLong));
    later.join();
    expectLost(result.status(), blob, "scene 'scene'");
    const RenderResult right = [&] {
      const auto peace = start(false);
      open(*peace);
      return mustRender(*peace, request(seed, kLong));
    }();
    open(*engine);
    EXPECT_EQ(firstDifference(mustRender(*engine, request(seed, kLong)), right), "") << "in the same engine";
    engine = start();
    open(*engine);
    EXPECT_EQ(firstDifference(mustRender(*engine, request(seed, kLong)), right), "") << "in the next one, with the terms on the disk";
  }
}

// Structures and posed scenes are shared by content; one scene's broken mapping must not be under another's picture.
TEST_F(BrokenBlob, WhoLoadedTheSameFileElsewhereIsNotTouched) {
  open(*engine);
  expectRight(*engine, request(1), "builds the structure");
  const std::string blob = blobs().at(0), aside = folder + "/aside";
  fs::rename(blob, aside);  // the mapping stays; the next load makes another
  open(*engine, "other");
  cut(aside, 0);
  v1::RenderRequest r = request(2);
  r.set_scene("other");
  const auto peace = start(false);
  open(*peace, "other");
  EXPECT_EQ(firstDifference(mustRender(*engine, r), mustRender(*peace, r)), "");
  expectLost(engine->render(request(3)).status(), blob, "scene 'scene'");
  EXPECT_EQ(blobs().size(), 1u) << "the other's blob stays";
  EXPECT_EQ(firstDifference(mustRender(*engine, r), mustRender(*peace, r)), "");
}

TEST_F(BrokenBlob, AReloadSharesTheMappingAndWhatWasBuiltOverIt) {
  open(*engine);
  expectRight(*engine, request(1), "first");
  const auto before = engine->scene("scene");
  ASSERT_TRUE(before.ok() && (*before)->file);
  open(*engine);
  EXPECT_EQ((*engine->scene("scene"))->file->id(), (*before)->file->id());
  EXPECT_GT(engine->inspectScene("scene")->bvh_ms(), 0.0) << "the structure is found";
}

TEST_F(BrokenBlob, RendersSideBySide) {
  for (int round = 0; round < thoroughOr(2, 1); ++round) {
    open(*engine);
    const std::string blob = blobs().at(0);
    std::vector<Result<RenderResult>> results(4, internalError("not run"));
    std::vector<std::thread> threads;
    for (size_t t = 0; t < results.size(); ++t)
      threads.emplace_back([&, t] {
        results[t] = engine->render(request(100 + t / 2 + 10 * uint64_t(round), kLong));  // two ask for the same
      });
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    cut(blob, 0.1 * round);
    for (std::thread& t : threads) t.join();
    int lost = 0;
    for (size_t t = 0; t < results.size(); ++t) {
      if (!results[t].ok()) {
        ++lost;
        EXPECT_TRUE(results[t].status().code() == Code::DataLoss || results[t].status().code() == Code::NotFound) << results[t].status().toString();
        continue;
      }
      const auto peace = start(false);
      open(*peace);
      EXPECT_EQ(firstDifference(*results[t], mustRender(*peace, request(100 + t / 2 + 10 * uint64_t(round), kLong))), "");
    }
    EXPECT_GT(lost, 0);
    open(*engine);
    for (uint64_t k = 0; k < 2; ++k) expectRight(*engine, request(100 + k + 10 * uint64_t(round), kLong), "afterwards");
  }
}

TEST_F(BrokenBlob, EnvironmentMaps) {
  open(*engine);
  const std::string own = blobs().at(0);
  ::utimensat(AT_FDCWD, map.c_str(), std::array<timespec, 2>{timespec{1000, 0}, timespec{1000, 0}}.data(), 0);
  std::this_thread::sleep_for(std::chrono::milliseconds(2050));  // its stamp may be trusted: the map is kept
  expectRight(*engine, lit(1), "before");
  std::string blob;
  for (const std::string& b : blobs())
    if (b != own) blob = b;
  ASSERT_FALSE(blob.empty());
  cut(blob, 0.5);
  expectLost(engine->render(lit(2)).status(), blob, "environment '" + map + "'");
  EXPECT_EQ(blobs().size(), 1u);
  expectRight(*engine, lit(2), "the request again");
  EXPECT_EQ(blobs().size(), 2u);
  EXPECT_EQ(engine->scene("scene").ok(), true) << "the scene had nothing to do with it";
}

}  // namespace
}  // namespace gobo::testing

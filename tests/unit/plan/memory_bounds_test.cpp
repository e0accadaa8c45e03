// SPDX-License-Identifier: Apache-2.0
// What an engine keeps between requests is bounded in bytes: scenes, environment maps, remembered requests; and one owner's much does not
// drive out another's little.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <random>

#include "plan/remembered_renders.h"
#include "plan/scene_library.h"
#include "scene/environment.h"
#include "scene/load.h"
#include "scene/scene.h"

namespace gobo::memory_bounds_test {
namespace {

/// Every file is the same built-in scene, every picture a map of 64 x 32 texels.
struct Files final : SceneLoader {
  Result<LoadedScene> scene(const std::string&, const StopToken&) override {
    GOBO_ASSIGN(ScenePtr s, makeBuiltinScene("furnace"));
    return LoadedScene{std::move(s), {}};
  }
  Result<EnvironmentPtr> environment(const std::string&, const StopToken&) override { return skyEnvironment({}, 64); }
};

class Bounds : public ::testing::Test {
 protected:
  Bounds() {
    char name[] = "/tmp/gobo-bounds-XXXXXX";
    folder = ::mkdtemp(name);
    bytes = (*makeBuiltinScene("furnace"))->bytes();
  }
  ~Bounds() override { std::filesystem::remove_all(folder); }
  SceneLibrary library(uint64_t scenes, uint64_t environmentBytes = UINT64_MAX) {
    return SceneLibrary({folder}, false, std::make_shared<Files>(), SceneLimits{scenes * bytes + bytes / 2, environmentBytes});
  }
  static SceneAccess token(const std::string& name) { return {name, false}; }
  std::string folder;
  uint64_t bytes = 0;
};

TEST_F(Bounds, TheLeastRecentlyUsedSceneGoes) {
  SceneLibrary l = library(3);
  for (const char* id : {"a", "b", "c"}) ASSERT_TRUE(l.openFile("f", "f", id).ok());
  ASSERT_TRUE(l.find("a").ok());
  ASSERT_TRUE(l.openFile("f", "f", "d").ok());
  EXPECT_TRUE(l.find("a").ok());
  const auto gone = l.find("b");
  EXPECT_EQ(gone.status().code(), Code::NotFound);
  EXPECT_NE(gone.status().message().find("engine.scene_bytes"), std::string::npos) << gone.status().message();
  EXPECT_LE(l.sceneBytes(), l.limits().sceneBytes);
}

TEST_F(Bounds, WhatIsRenderedStaysAndThenTheLoadIsRefused) {
  SceneLibrary l = library(2);
  ASSERT_TRUE(l.openFile("f", "f", "a").ok());
  ASSERT_TRUE(l.openFile("f", "f", "b").ok());
  const ScenePtr a = *l.find("a"), b = *l.find("b");
  const auto refused = l.openFile("f", "f", "c");
  EXPECT_EQ(refused.status().code(), Code::ResourceExhausted);
  EXPECT_NE(refused.status().message().find("engine.scene_bytes"), std::string::npos);
  EXPECT_TRUE(l.find("a").ok() && l.find("b").ok());
  EXPECT_TRUE(l.openFile("f", "f", "a").ok()) << "replacing one takes no room";
}

TEST_F(Bounds, WhoLoadsMuchMakesRoomForHimself) {
  SceneLibrary l = library(4);
  ASSERT_TRUE(l.openFile("f", "f", "victim", {}, token("victim")).ok());
  for (int i = 0; i < 84; ++i) ASSERT_TRUE(l.openFile("f", "f", "flood-" + std::to_string(i), {}, token("greedy")).ok());
  EXPECT_TRUE(l.find("victim", {}, token("victim")).ok());
  EXPECT_EQ(l.count(), 4u);
}

TEST_F(Bounds, EnvironmentsAreBoundedInBytes) {
  const uint64_t one = 64 * 32 * sizeof(Vec3);
  SceneLibrary l = library(1, 3 * one + one / 2);
  for (int i = 0; i < 10; ++i) {
    const std::string path = folder + "/" + std::to_string(i) + ".hdr";
    std::ofstream(path) << i;
    std::filesystem::last_write_time(path, std::filesystem::file_time_type::clock::now() - std::chrono::hours(1));  // settled
    ASSERT_TRUE(l.environment(path).ok());
    EXPECT_LE(l.environmentBytes(), 3 * one);
  }
  SceneLibrary none = library(1, one / 2);  // larger than the bound alone: used, not kept
  ASSERT_TRUE(none.environment(folder + "/1.hdr").ok());
  EXPECT_EQ(none.environmentBytes(), 0u);
}

v1::RenderRequest request(size_t bytes) {
  v1::RenderRequest r;
  r.set_scene(std::string(bytes, 's'));
  return r;
}

TEST(RememberedBounds, BytesAndNumberAndWhoseGoFirst) {
  RememberedRenders r(1000, 1 << 20);
  const std::string mine = r.add(request(1000), "victim");
  for (int i = 0; i < 134; ++i) {
    r.add(request(200000), "greedy");
    EXPECT_LE(r.bytes(), 1u << 20);
  }
  EXPECT_TRUE(r.find(mine, "victim"));
  RememberedRenders few(16);
  const std::string kept = few.add(request(1), "victim");
  std::string last;
  for (int i = 0; i < 1000; ++i) last = few.add(request(1), "greedy");
  EXPECT_TRUE(few.find(kept, "victim"));
  EXPECT_TRUE(few.find(last, "greedy"));
}

// Model: a list of entries; the sum of what the ids still stand for is what bytes() says.
TEST(RememberedBounds, RandomUseKeepsItsBooks) {
  std::mt19937 random(3);
  RememberedRenders r(50, 100000);
  std::vector<std::pair<std::string, std::string>> all;
  for (int i = 0; i < 3000; ++i) {
    const std::string owner(1, char('a' + random() % 5));
    if (random() % 3 == 0 && !all.empty()) {
      const auto& [id, of] = all[random() % all.size()];
      const auto found = r.find(id, of);
      if (found) { EXPECT_FALSE(r.find(id, of == "a" ? "b" : "a")); }
    } else {
      all.emplace_back(r.add(request(random() % 5000), owner), owner);
    }
    size_t known = 0;
    if (i % 100 == 0)
      for (const auto& [id, of] : all) known += r.find(id, of).has_value();
    EXPECT_LE(known, 50u);
    EXPECT_LE(r.bytes(), 100000u);
  }
}

}  // namespace
}  // namespace gobo::memory_bounds_test

// SPDX-License-Identifier: Apache-2.0
// The scene library under every pair of its calls at once, and under all of them in random order: every answer is one that some order of
// the calls gives. CI runs this under the thread sanitizer too.
#include "plan/scene_library.h"
#include "import/load.h"

#include <gtest/gtest.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <functional>
#include <random>
#include <thread>

namespace gobo::scene_library_test {
namespace {

const char* const kIds[] = {"cornell", "furnace"};

class SceneLibraryCalls : public ::testing::Test {
 protected:
  SceneLibraryCalls() {
    char name[] = "/tmp/gobo-library-XXXXXX";
    folder = ::mkdtemp(name);
    std::ofstream sky(folder + "/sky.hdr", std::ios::binary);
    sky << "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n" << std::string(4 * 2 * 4, '\x80');
  }
  ~SceneLibraryCalls() override { std::filesystem::remove_all(folder); }

  using Call = std::function<Status(SceneLibrary&, const std::string& id, uint32_t draw)>;
  struct Named {
    const char* name;
    Call call;
  };
  /// What is told of a scene is told of one scene, whole.
  static Status whole(const Result<v1::SceneInfo>& info, const std::string& id) {
    if (!info.ok()) return info.status();
    EXPECT_EQ(info->id(), id);
    EXPECT_FALSE(info->hash().empty());
    EXPECT_GT(info->instances(), 0u);
    return {};
  }
  std::vector<Named> calls() const {
    return {
        {"open", [](SceneLibrary& l, const std::string& id, uint32_t) { return whole(l.open(id, id), id); }},
        {"find",
         [](SceneLibrary& l, const std::string& id, uint32_t) {
           const Result<ScenePtr> s = l.find(id);
           if (s.ok()) { EXPECT_GT((*s)->triangleCount(), 0u); }
           return s.status();
         }},
        {"inspect", [](SceneLibrary& l, const std::string& id, uint32_t) { return whole(l.inspect(id), id); }},
        {"list",
         [](SceneLibrary& l, const std::string&, uint32_t) {
           for (const v1::SceneInfo& info : l.list()) EXPECT_TRUE(whole(info, info.id()).ok());
           return Status();
         }},
        {"patch",
         [](SceneLibrary& l, const std::string& id, uint32_t draw) {
           v1::PatchSceneRequest p;
           p.set_scene(id);
           const Result<ScenePtr> s = l.find(id);
           if (!s.ok()) return s.status();
           (*p.mutable_materials())[(*s)->materials[draw % (*s)->materials.size()].name].set_roughness(double(draw % 100) / 100);
           return whole(l.patch(p), id);
         }},
        {"unload", [](SceneLibrary& l, const std::string& id, uint32_t) { return l.unload(id); }},
        {"load", [](SceneLibrary& l, const std::string& id, uint32_t) { return l.load(id, false).status(); }},
        {"environment", [this](SceneLibrary& l, const std::string&, uint32_t) { return l.environment(folder + "/sky.hdr").status(); }},
        {"roots",
         [this](SceneLibrary& l, const std::string&, uint32_t) {
           l.setRoots({folder});
           EXPECT_LE(l.count(), std::size(kIds));
           return l.allowedPath(folder + "/sky.hdr", "path").status();
         }},
    };
  }
  static void expectAllowed(const Status& s, const char* name) { EXPECT_TRUE(s.ok() || s.code() == Code::NotFound) << name << ": " << s.toString(); }
  std::string folder;
};

TEST_F(SceneLibraryCalls, EveryPairAtOnce) {
  const std::vector<Named> all = calls();
  for (const Named& a : all)
    for (const Named& b : all) {
      SceneLibrary library({folder}, false, inProcessLoader());
      std::atomic<int> ready{0};
      const auto work = [&](const Named& named, uint32_t seed) {
        std::mt19937 g(seed);
        ++ready;
        while (ready < 2) std::this_thread::yield();
        for (int i = 0; i < 8; ++i) expectAllowed(named.call(library, kIds[0], uint32_t(g())), named.name);
      };
      std::thread other([&] { work(b, 2); });
      work(a, 1);
      other.join();
      ASSERT_FALSE(HasFailure()) << a.name << " beside " << b.name;
    }
}

TEST_F(SceneLibraryCalls, AllInRandomOrder) {
  const std::vector<Named> all = calls();
  SceneLibrary library({folder}, false, inProcessLoader());
  std::vector<std::thread> threads;
  for (uint32_t t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      std::mt19937 g(t);
      for (int i = 0; i < 200; ++i) {
        const Named& named = all[g() % all.size()];
        expectAllowed(named.call(library, kIds[g() % 2], uint32_t(g())), named.name);
      }
    });
  for (std::thread& t : threads) t.join();
  for (const char* id : kIds) (void)library.unload(id);
  EXPECT_EQ(library.count(), 0u);
}

// That a scene was unloaded for want of room is told to those who could use it, and to nobody else.
TEST(SceneLibrary, OthersAreNotToldOfASceneThatWent) {
  SceneLibrary library({}, false, inProcessLoader());
  const SceneAccess ann{"ann", false}, bob{"bob", false}, eve{"eve", false};
  ASSERT_TRUE(library.open("cornell", "secret", {}, ann, {"bob"}).ok());
  library.shrinkScenes(0);
  for (const auto& [access, told] : {std::pair(ann, true), {bob, true}, {eve, false}}) {
    const Status gone = library.find("secret", {}, access).status();
    EXPECT_EQ(gone.code(), Code::NotFound);
    EXPECT_EQ(gone.message().find("unloaded") != std::string::npos, told) << access.caller << ": " << gone.message();
  }
}

Status patchFirstMaterial(SceneLibrary& library, const std::string& id) {
  const Result<ScenePtr> scene = library.find(id);
  if (!scene.ok()) return scene.status();
  v1::PatchSceneRequest p;
  p.set_scene(id);
  (*p.mutable_materials())[(*scene)->materials[0].name].mutable_base_color()->set_x(0.123);
  return library.patch(p).status();
}

// A built-in comes back by itself where it is what it was: one that was patched, or that stood for another scene, would come back as another, and nobody told.
TEST(SceneLibrary, APatchedBuiltinThatWentIsNotMadeAnew) {
  SceneLibrary library({}, false, inProcessLoader());
  const SceneAccess ann{"ann", false};
  const auto gone = [&](const std::string& id, const SceneAccess& access = {}) {
    const Status found = library.find(id, {}, access).status(), inspected = library.inspect(id, access).status();
    EXPECT_EQ(found.code(), Code::NotFound) << id;
    EXPECT_EQ(inspected.code(), Code::NotFound) << id;
    EXPECT_NE(found.message().find("no scene '" + id + "', which was unloaded to make room (engine.memory_bytes): open it again"), std::string::npos)
        << found.message();
    EXPECT_EQ(library.count(), 0u);
  };
  const std::string pristine = library.inspect("cornell")->hash();
  library.shrinkScenes(0);
  EXPECT_EQ(library.count(), 0u);
  ASSERT_TRUE(library.find("cornell").ok()) << "as it was";
  ASSERT_TRUE(patchFirstMaterial(library, "cornell").ok());
  EXPECT_NE(library.inspect("cornell")->hash(), pristine);
  library.shrinkScenes(0);
  gone("cornell");
  gone("cornell", ann);
  EXPECT_TRUE(library.find("furnace").ok()) << "others are made";
  library.shrinkScenes(0);
  gone("cornell");
  ASSERT_TRUE(library.open("cornell", "cornell").ok());
  EXPECT_EQ(library.inspect("cornell")->hash(), pristine);
  library.shrinkScenes(0);
  EXPECT_TRUE(library.find("cornell").ok()) << "it is the built-in again";

  ASSERT_TRUE(patchFirstMaterial(library, "cornell").ok());  // a token that may change nothing opens it as everybody's
  library.shrinkScenes(0);
  gone("cornell", ann);
  ASSERT_TRUE(library.open("cornell", "", {}, ann).ok());
  EXPECT_EQ(library.inspect("cornell")->hash(), pristine);

  ASSERT_TRUE(library.open("furnace", "cornell").ok());  // another scene under its name
  library.shrinkScenes(0);
  gone("cornell");
}

// Of ids that went the last thousand are known, and changed built-ins always.
TEST(SceneLibrary, ChangedBuiltinsThatWentAreNotForgotten) {
  SceneLibrary library({}, false, inProcessLoader());
  ASSERT_TRUE(patchFirstMaterial(library, "furnace").ok());
  library.shrinkScenes(0);
  for (int i = 0; i < 1010; ++i) {
    ASSERT_TRUE(library.open("furnace", "other" + std::to_string(i)).ok());
    library.shrinkScenes(0);
  }
  EXPECT_NE(library.find("furnace").status().message().find("open it again"), std::string::npos);
  EXPECT_EQ(library.find("other5").status().message().find("open it again"), std::string::npos);
  EXPECT_NE(library.find("other1009").status().message().find("open it again"), std::string::npos);
}

}  // namespace
}  // namespace gobo::scene_library_test

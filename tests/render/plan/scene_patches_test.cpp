// SPDX-License-Identifier: Apache-2.0
// Scenes that several callers change at the same time: no patch is lost, and what was unloaded stays unloaded.
#include <gtest/gtest.h>

#include <atomic>
#include <functional>
#include <limits>
#include <optional>
#include <thread>

#include "support/engines.h"
#include "support/thorough.h"

namespace gobo::testing {
namespace {

TEST(ScenePatches, OfPatchesAtTheSameTimeNoneIsLost) {
  const auto engine = makeEngine();
  ASSERT_TRUE(engine->openScene("lamps", "lamps").ok());
  const auto before = engine->inspectScene("lamps");
  ASSERT_TRUE(before.ok());
  constexpr int kThreads = 4, kEach = 40;
  ASSERT_GE(before->lights_size(), kThreads * kEach);
  const auto power = [](int k) { return 1000.0 + k; };  // every patch has a light of its own: what is lost is seen
  std::vector<std::thread> threads;
  std::atomic<int> refused{0};
  for (int t = 0; t < kThreads; ++t)
    threads.emplace_back([&, t] {
      for (int i = 0; i < kEach; ++i) {
        const int k = t * kEach + i;
        v1::PatchSceneRequest p;
        p.set_scene("lamps");
        v1::LightEdit& edit = (*p.mutable_lights())[before->lights(k).name()];
        edit.mutable_color()->set_x(1);
        edit.mutable_color()->set_y(1);
        edit.mutable_color()->set_z(1);
        edit.set_intensity(power(k));
        refused += !engine->patchScene(p).ok();
      }
    });
  for (std::thread& t : threads) t.join();
  EXPECT_EQ(refused, 0);
  const auto after = engine->inspectScene("lamps");
  ASSERT_TRUE(after.ok());
  int lost = 0;
  for (int k = 0; k < kThreads * kEach; ++k) lost += after->lights(k).power().x() != float(power(k));
  EXPECT_EQ(lost, 0) << "of " << kThreads * kEach;
}

TEST(ScenePatches, AThingIsMovedFromWhereItIs) {
  const auto engine = makeEngine();
  ASSERT_TRUE(engine->openScene("cornell", "cornell").ok());
  const auto patch = [&](const std::function<void(v1::InstancePatch&)>& fill) {
    v1::PatchSceneRequest p;
    p.set_scene("cornell");
    fill((*p.mutable_instances())["tall"]);
    return engine->patchScene(p);
  };
  const auto matrix = [](v1::InstancePatch& i, float x) {
    for (int k = 0; k < 16; ++k) i.add_matrix(k == 12 ? x : k % 5 == 0 ? 1.0f : 0.0f);
  };
  const auto by = [](v1::InstancePatch& i, double x, double y) {
    i.mutable_moved_by()->set_x(x);
    i.mutable_moved_by()->set_y(y);
  };
  ASSERT_TRUE(patch([&](auto& i) { matrix(i, 0.25f); }).ok());
  const auto wanted = engine->inspectScene("cornell");
  ASSERT_TRUE(patch([&](auto& i) { matrix(i, 0.0f); }).ok());
  ASSERT_TRUE(patch([&](auto& i) { by(i, 0.5, 1.0); }).ok());
  EXPECT_NE(engine->inspectScene("cornell")->hash(), wanted->hash());
  ASSERT_TRUE(patch([&](auto& i) { by(i, -0.25, -1.0); }).ok());  // on top of the first
  EXPECT_EQ(engine->inspectScene("cornell")->hash(), wanted->hash());
  ASSERT_TRUE(patch([&](auto& i) {  // on top of a matrix
                matrix(i, 1.0f);
                by(i, -0.75, 0.0);
              })
                  .ok());
  EXPECT_EQ(engine->inspectScene("cornell")->hash(), wanted->hash());

  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), 1e39}) {
    const auto refused = patch([&](auto& i) { by(i, bad, 0.0); });
    ASSERT_FALSE(refused.ok()) << bad;
    EXPECT_EQ(refused.status().code(), Code::InvalidArgument);
    EXPECT_EQ(refused.status().location(), "instances.tall.moved_by");
  }
  EXPECT_FALSE(patch([](auto&) {}).ok()) << "neither matrix nor way";
  EXPECT_EQ(engine->inspectScene("cornell")->hash(), wanted->hash());
}

// A colour by itself keeps the intensity, an intensity the colour, whatever came before.
TEST(ScenePatches, ColourAndIntensityKeepEachOther) {
  const auto engine = makeEngine();
  ASSERT_TRUE(engine->openScene("spheres", "spheres").ok());
  const std::string name = engine->inspectScene("spheres")->lights(0).name();
  const auto power = [&](std::optional<Vec3> color, std::optional<double> intensity) {
    v1::PatchSceneRequest p;
    p.set_scene("spheres");
    v1::LightEdit& edit = (*p.mutable_lights())[name];
    if (color) {
      edit.mutable_color()->set_x(color->x);
      edit.mutable_color()->set_y(color->y);
      edit.mutable_color()->set_z(color->z);
    }
    if (intensity) edit.set_intensity(*intensity);
    const auto info = engine->patchScene(p);
    EXPECT_TRUE(info.ok()) << info.status().toString();
    const v1::Vector3 v = info.ok() ? info->lights(0).power() : v1::Vector3();
    return Vec3(float(v.x()), float(v.y()), float(v.z()));
  };
  const Vec3 red(1, 0, 0), black(0.0f), white(1.0f), blue(0, 0, 0.5f);
  EXPECT_EQ(power(white, 10), Vec3(10.0f));
  EXPECT_EQ(power(red, {}), Vec3(10, 0, 0));
  EXPECT_EQ(power(red, {}), Vec3(10, 0, 0));
  EXPECT_EQ(power({}, 4), Vec3(4, 0, 0));
  EXPECT_EQ(power(black, {}), black);
  EXPECT_EQ(power(blue, {}), Vec3(0, 0, 2));
  EXPECT_EQ(power({}, 0), black);
  EXPECT_EQ(power({}, 6), Vec3(0, 0, 3));
  EXPECT_EQ(power(white, {}), Vec3(6.0f));
}

TEST(ScenePatches, APatchThatRacesAnUnloadDoesNotBringTheIdBack) {
  const auto engine = makeEngine();
  for (int round = 0; round < thoroughOr(30, 10); ++round) {
    ASSERT_TRUE(engine->openScene("lamps", "gone").ok());
    v1::PatchSceneRequest p;
    p.set_scene("gone");
    (*p.mutable_lights())[engine->inspectScene("gone")->lights(0).name()].set_intensity(5 + round);
    Status patched;
    std::thread patcher([&] { patched = engine->patchScene(p).status(); });
    std::this_thread::yield();
    const Status unloaded = engine->unloadScene("gone");
    patcher.join();
    ASSERT_TRUE(unloaded.ok()) << unloaded.toString();
    ASSERT_TRUE(patched.ok() || patched.code() == Code::NotFound) << patched.toString();
    for (const v1::SceneInfo& s : engine->listScenes()) ASSERT_NE(s.id(), "gone") << "round " << round;
  }
}

TEST(ScenePatches, ABuiltInSceneThatIsOpenedByUseDoesNotUndoAPatch) {
  for (int round = 0; round < 10; ++round) {
    const auto engine = makeEngine();
    v1::PatchSceneRequest p;
    p.set_scene("cornell");
    std::atomic<bool> go{false};
    std::vector<std::thread> users;
    for (int t = 0; t < 3; ++t)
      users.emplace_back([&] {
        while (!go) std::this_thread::yield();
        EXPECT_TRUE(engine->scene("cornell").ok());  // opens it
      });
    go = true;
    const auto info = engine->inspectScene("cornell");
    ASSERT_TRUE(info.ok());
    (*p.mutable_materials())[info->material_names(0)].mutable_base_color()->set_x(0.123f);
    const auto patched = engine->patchScene(p);
    ASSERT_TRUE(patched.ok()) << patched.status().toString();
    for (std::thread& t : users) t.join();
    EXPECT_EQ(engine->inspectScene("cornell")->hash(), patched->hash()) << "round " << round;
  }
}

}  // namespace
}  // namespace gobo::testing

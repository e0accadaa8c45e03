// SPDX-License-Identifier: Apache-2.0
// Scenes that several callers change at the same time: no patch is lost, and what was unloaded stays unloaded.
#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "support/engines.h"

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

TEST(ScenePatches, APatchThatRacesAnUnloadDoesNotBringTheIdBack) {
  const auto engine = makeEngine();
  for (int round = 0; round < 30; ++round) {
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

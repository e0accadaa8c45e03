// SPDX-License-Identifier: Apache-2.0
// Each kind of data alone may have far more than all of them together: caches give way, to each other and to scenes, and pictures stay the same.
#include <gtest/gtest.h>

#include "import/load.h"
#include "plan/engine.h"

namespace gobo::engine_memory_test {
namespace {

v1::RenderRequest request(int seed) {
  v1::RenderRequest r;
  r.set_scene(seed % 2 ? "cornell" : "fence");
  r.set_width(96);
  r.set_height(64);
  r.set_seed(uint64_t(seed));  // no term serves two
  r.mutable_halt()->set_spp(1);
  return r;
}

std::vector<float> picture(Engine& engine, int seed) {
  const auto result = engine.render(request(seed));
  EXPECT_TRUE(result.ok()) << result.status().toString();
  if (!result.ok()) return {};
  const auto pixels = result->images.at(0).pixels();
  return {pixels.begin(), pixels.end()};
}

std::unique_ptr<Engine> engineOf(uint64_t memoryBytes) {
  EngineOptions o;
  o.loader = inProcessLoader();
  o.threads = 2;
  o.memoryBytes = memoryBytes;
  auto engine = Engine::create(o);
  EXPECT_TRUE(engine.ok());
  return std::move(*engine);
}

TEST(EngineMemory, StaysWithinTheTotalAndGivesTheSamePictures) {
  constexpr int kPictures = 12;
  const auto free = engineOf(UINT64_MAX);
  std::vector<std::vector<float>> truth;
  for (int i = 0; i < kPictures; ++i) truth.push_back(picture(*free, i));
  const uint64_t total = free->memory().held() / 4;
  const auto bound = engineOf(total);
  for (int round = 0; round < 2; ++round)
    for (int i = 0; i < kPictures; ++i) {
      EXPECT_EQ(picture(*bound, i), truth[size_t(i)]);
      EXPECT_LE(bound->memory().held(), total) << "picture " << i;
    }
  EXPECT_GT(bound->memory().held(), total / 2);
}

TEST(EngineMemory, WhatSomebodyHoldsElsewhereCountsToo) {
  const auto engine = engineOf(64 << 20);
  for (int i = 0; i < 4; ++i) picture(*engine, i);
  const uint64_t held = engine->memory().held();
  ASSERT_GT(held, 0u);
  uint64_t others = 0;
  const auto account = engine->memory().add({"others", [] { return UINT64_MAX; }, [&] { return others; }});
  others = (64 << 20) - held / 2;
  const std::vector<float> under = picture(*engine, 5);
  EXPECT_LE(engine->memory().held() - others, held / 2);
  others = 0;
  EXPECT_EQ(picture(*engine, 5), under);
  // More than there is: a scene is refused, and nothing is left of it.
  others = 64 << 20;
  const auto refused = engine->openScene("grids", "mine");
  EXPECT_EQ(refused.status().code(), Code::ResourceExhausted) << refused.status().toString();
  EXPECT_NE(refused.status().message().find("others 67108864"), std::string::npos) << refused.status().message();
  others = 0;
  EXPECT_EQ(engine->inspectScene("mine").status().code(), Code::NotFound);
  EXPECT_TRUE(engine->openScene("grids", "mine").ok());
}

}  // namespace
}  // namespace gobo::engine_memory_test

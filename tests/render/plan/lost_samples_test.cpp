// SPDX-License-Identifier: Apache-2.0
// Values at the end of float's range: what a picture can hold it holds, and what it cannot is counted and said, by the reply itself and
// whatever of it came from the store.
#include <gtest/gtest.h>

#include "support/engines.h"
#include "support/tiny_scenes.h"

namespace gobo::testing {
namespace {

v1::RenderRequest underSky(const std::string& radiance) {
  v1::RenderRequest r = smallRequest("cornell", 16, 12, 16);
  for (const std::string& a : {"environment.constant=" + radiance, std::string("camera.position=0,1,8"), std::string("lights.light.enabled=false")}) set(r, a);
  return r;
}
std::string warnings(const RenderResult& r) {
  std::string all;
  for (const std::string& w : r.reply.warnings()) all += w + "\n";
  return all;
}

TEST(LostSamples, ThreeLargeChannelsAreNotOneInfinity) {
  const auto engine = makeEngine();
  const RenderResult r = mustRender(*engine, underSky("1.2e38,1.2e38,1.2e38"));
  ASSERT_EQ(r.images.size(), 1u);
  const Image& beauty = r.images[0].image();
  EXPECT_FLOAT_EQ(beauty.rgb(0, 0).x, 1.2e38f) << "the sky beside the box";
  EXPECT_EQ(warnings(r), "");
}

/// A lamp so strong that what arrives near it is beyond float.
ScenePtr burning() {
  tests::SceneMaker m;
  m.instance(m.mesh(tests::ground(1.0f), m.material(Vec3(0.5f))));
  LightShape lamp;
  lamp.position = Vec3(0, 0.05f, 0);
  m.light(lamp, Vec3(1e37f));
  m.camera(Vec3(0, 2, 1), Vec3(0.0f));
  return m.finish();
}
RenderResult renderBurning(Engine& engine, uint32_t spp, const std::string& filter = {}) {
  v1::RenderRequest r;
  r.set_width(16);
  r.set_height(12);
  r.mutable_halt()->set_spp(spp);
  if (!filter.empty()) set(r, "denoise=" + filter);
  RenderControl control;
  control.scene = burning();
  Result<RenderResult> made = engine.render(r, control);
  EXPECT_TRUE(made.ok()) << made.status().toString();
  return std::move(*made);
}

// Filters know nothing of samples that are missing; the picture does, and each counts once although it is in the light and in what is filtered of it.
TEST(LostSamples, CountOnceInADenoisedPicture) {
  const auto lost = [](const RenderResult& r) {
    for (const auto& row : r.reply.plan())
      if (row.node() == "beauty") return row.dropped_samples();
    return uint64_t(0);
  };
  const uint64_t plain = lost(renderBurning(*makeEngine(), 16));
  EXPECT_GT(plain, 0u);
  for (const char* filter : {"joint_bilateral", "auto"}) EXPECT_EQ(lost(renderBurning(*makeEngine(), 16, filter)), plain) << filter;
}

TEST(LostSamples, WhatDoesNotFitIsCounted) {
  const auto engine = makeEngine();
  const RenderResult cold = renderBurning(*engine, 16);
  uint64_t dropped = 0;
  for (const auto& row : cold.reply.plan()) dropped += row.dropped_samples();
  EXPECT_GT(dropped, 0u);
  EXPECT_NE(warnings(cold).find("beauty: "), std::string::npos) << warnings(cold);
  EXPECT_NE(warnings(cold).find("samples in"), std::string::npos) << warnings(cold);
  // The same words when everything is reused, when it is extended, and in another engine.
  EXPECT_EQ(warnings(renderBurning(*engine, 16)), warnings(cold));
  const RenderResult extended = renderBurning(*engine, 32);
  EXPECT_EQ(warnings(extended), warnings(renderBurning(*makeEngine(), 32)));
  EXPECT_NE(warnings(extended), warnings(cold)) << "more samples, more of them lost";
}

TEST(LostSamples, OrdinaryPicturesLoseNone) {
  const auto engine = makeEngine();
  for (const char* scene : {"cornell", "spheres"}) EXPECT_EQ(warnings(mustRender(*engine, smallRequest(scene))), "") << scene;
}

}  // namespace
}  // namespace gobo::testing

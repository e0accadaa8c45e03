// SPDX-License-Identifier: Apache-2.0
// Values at the end of float's range: what a picture can hold it holds, and what it cannot is counted and said, by the reply itself and
// whatever of it came from the store.
#include <gtest/gtest.h>

#include "support/engines.h"

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

TEST(LostSamples, WhatDoesNotFitIsCounted) {
  const auto engine = makeEngine();
  v1::RenderRequest r = underSky("1,1,1");
  for (const char* a : {"lights.near.kind=POINT", "lights.near.position=0,0.05,0", "lights.near.intensity=1e37"}) set(r, a);   // beyond float where it is near
  const RenderResult cold = mustRender(*engine, r);
  uint64_t dropped = 0;
  for (const auto& row : cold.reply.plan()) dropped += row.dropped_samples();
  EXPECT_GT(dropped, 0u);
  EXPECT_NE(warnings(cold).find("beauty: "), std::string::npos) << warnings(cold);
  EXPECT_NE(warnings(cold).find("samples in"), std::string::npos) << warnings(cold);
  // The same words when everything is reused, when it is extended, and in another engine.
  EXPECT_EQ(warnings(mustRender(*engine, r)), warnings(cold));
  r.mutable_halt()->set_spp(32);
  const RenderResult extended = mustRender(*engine, r);
  EXPECT_EQ(warnings(extended), warnings(mustRender(*makeEngine(), r)));
  EXPECT_NE(warnings(extended), warnings(cold)) << "more samples, more of them lost";
}

TEST(LostSamples, OrdinaryPicturesLoseNone) {
  const auto engine = makeEngine();
  for (const char* scene : {"cornell", "spheres"}) EXPECT_EQ(warnings(mustRender(*engine, smallRequest(scene))), "") << scene;
}

}  // namespace
}  // namespace gobo::testing

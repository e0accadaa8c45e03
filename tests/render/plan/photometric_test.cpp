// SPDX-License-Identifier: Apache-2.0
// request.photometric: a file's candela and lux become W/sr and W/m^2 as gains; what a request says itself stays.
#include <gtest/gtest.h>

#include <fstream>

#include "support/engines.h"
#include "support/small_gltf.h"
#include "support/temp_folder.h"

namespace gobo::testing::photometric_test {
namespace {

class Photometric : public ::testing::Test {
 protected:
  v1::RenderRequest request(const std::string& intensity) {
    std::string text = smallGltf("");
    const std::string was = R"("intensity":10)";
    text.replace(text.find(was), was.size(), R"("intensity":)" + intensity);
    const std::string path = folder_.path + "/" + intensity + ".gltf";
    std::ofstream(path) << text;
    EXPECT_TRUE(engine_->openScene(path, path).ok());
    return smallRequest(path, 16, 12, 16);
  }
  static std::unique_ptr<Engine> makeEngineWith(const std::string& path) {
    auto engine = makeEngine(0);
    EXPECT_TRUE(engine->openScene(path, path).ok());
    return engine;
  }
  static bool warns(const RenderResult& r) {
    for (const std::string& w : r.reply.warnings())
      if (w.find("request.photometric") != std::string::npos) return true;
    return false;
  }
  static void expectScaled(const RenderResult& a, const RenderResult& b, double factor) {
    double sum = 0;
    for (size_t i = 0; i < a.images[0].image().data.size(); ++i) {
      const double v = a.images[0].image().data[i] * factor;
      EXPECT_NEAR(b.images[0].image().data[i], v, 1e-5 * v);
      sum += v;
    }
    EXPECT_GT(sum, 0.0);
  }
  test::TempFolder folder_;
  std::unique_ptr<Engine> engine_ = makeEngine();
};

TEST_F(Photometric, IsAGainOfTheFilesLights) {
  for (const char* way : {"integrator.max_groups=16", "integrator.max_groups=1", "shadows.ray_traced.samples=2"}) {
    v1::RenderRequest r = request("10");
    set(r, way);
    const RenderResult plain = mustRender(*engine_, r);
    set(r, "photometric=true");
    const RenderResult gained = mustRender(*engine_, r);
    expectScaled(plain, gained, 1.0 / 683.0);
    for (const auto& [name, row] : nodesBy(gained, v1::NodeReport::RUN)) EXPECT_EQ(row.rays(), 0u) << way << ": " << name;
    EXPECT_EQ(firstDifference(gained, mustRender(*makeEngineWith(r.scene()), r)), "") << way;
  }
}

TEST_F(Photometric, ScalesAClusterAsAWholeAndAMixedOneLightByLight) {
  std::string text = smallGltf("");
  const auto replace = [&](const std::string& from, const std::string& to) {
    ASSERT_NE(text.find(from), std::string::npos) << from;
    text.replace(text.find(from), from.size(), to);
  };
  replace(R"("nodes":[0,1])", R"("nodes":[0,1,2])");
  replace(R"({"KHR_lights_punctual":{"light":0}}}])",
          R"({"KHR_lights_punctual":{"light":0}}},{"name":"other","translation":[0.5,0.2,1],"extensions":{"KHR_lights_punctual":{"light":0}}}])");
  const std::string path = folder_.path + "/two.gltf";
  std::ofstream(path) << text;
  ASSERT_TRUE(engine_->openScene(path, path).ok());
  v1::RenderRequest r = smallRequest(path, 16, 12, 16);
  set(r, "integrator.max_groups=1");
  const RenderResult plain = mustRender(*engine_, r);
  set(r, "photometric=true");
  const RenderResult gained = mustRender(*engine_, r);
  expectScaled(plain, gained, 1.0 / 683.0);
  for (const auto& [name, row] : nodesBy(gained, v1::NodeReport::RUN)) EXPECT_EQ(row.rays(), 0u) << name;

  // With a light of the request's own in the cluster, or one that it gives an intensity: what each of them brings, in groups of their own.
  for (const std::vector<const char*>& edits : std::vector<std::vector<const char*>>{
           {"lights.mine.kind=POINT", "lights.mine.position=0,0.5,1", "lights.mine.intensity=0.01"}, {"lights.lamp.intensity=0.02"}}) {
    v1::RenderRequest mixed = r;
    for (const char* e : edits) set(mixed, e);
    mixed.mutable_halt()->set_spp(256);
    v1::RenderRequest apart = mixed;
    set(apart, "integrator.max_groups=16");
    const RenderResult a = mustRender(*engine_, mixed), b = mustRender(*engine_, apart);
    double sumA = 0, sumB = 0;
    for (const float v : a.images[0].image().data) sumA += v;
    for (const float v : b.images[0].image().data) sumB += v;
    EXPECT_NEAR(sumA, sumB, 0.03 * sumB) << edits[0];
  }
}

TEST_F(Photometric, WhatTheRequestSaysIsRadiometric) {
  v1::RenderRequest r = request("10");
  set(r, "lights.lamp.intensity=3");
  const RenderResult plain = mustRender(*engine_, r);
  set(r, "photometric=true");
  EXPECT_EQ(firstDifference(plain, mustRender(*engine_, r)), "");

  v1::RenderRequest added = request("10");
  set(added, "lights.lamp.enabled=false");
  set(added, "lights.mine.kind=POINT");
  set(added, "lights.mine.position=0,0,2");
  set(added, "lights.mine.intensity=5");
  const RenderResult before = mustRender(*engine_, added);
  set(added, "photometric=true");
  EXPECT_EQ(firstDifference(before, mustRender(*engine_, added)), "");

  // Colours and gains are on top of what the file's intensity is read as.
  v1::RenderRequest coloured = request("10");
  set(coloured, "lights.lamp.color=1,0.5,0.25");
  set(coloured, "lights.lamp.gain=2,2,2");
  const RenderResult a = mustRender(*engine_, coloured);
  set(coloured, "photometric=true");
  expectScaled(a, mustRender(*engine_, coloured), 1.0 / 683.0);
}

TEST_F(Photometric, AWarningNamesTheFieldWhereAFileIsFarTooBright) {
  v1::RenderRequest bright = request("6830");
  EXPECT_TRUE(warns(mustRender(*engine_, bright)));
  set(bright, "photometric=true");
  EXPECT_FALSE(warns(mustRender(*engine_, bright)));
  bright.clear_photometric();
  set(bright, "lights.lamp.intensity=6830");  // the request's own words
  EXPECT_FALSE(warns(mustRender(*engine_, bright)));
  EXPECT_FALSE(warns(mustRender(*engine_, request("10"))));
}

}  // namespace
}  // namespace gobo::testing::photometric_test

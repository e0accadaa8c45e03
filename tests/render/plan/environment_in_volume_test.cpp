// SPDX-License-Identifier: Apache-2.0
// Whoever stands for an environment leaves it to the path tracer where the camera is inside a volume, which takes from what it sees.
#include <gtest/gtest.h>

#include "support/engines.h"
#include "support/tiny_scenes.h"

namespace gobo::testing::environment_in_volume_test {
namespace {

using tests::SceneMaker;

/// A floor inside of a box that absorbs and bends nothing; the camera within it, or above it.
ScenePtr aquarium(bool inside) {
  SceneMaker m;
  m.instance(m.mesh(tests::ground(1.5f), m.material(Vec3(0.6f))));
  m.instance(m.mesh(tests::box(Vec3(-2, -0.5f, -2), Vec3(2, 2, 2)), m.material(Vec3(1.0f), [](Material& x) {
    x.bsdf = {};
    x.bsdf.roughness = 0.0f;
    x.bsdf.transmission = 1.0f;
    x.bsdf.ior = 1.0f;
    x.bsdf.thickness = 1.0f;
    x.bsdf.attenuationColor = Vec3(0.7f, 0.8f, 0.9f);
    x.bsdf.attenuationDistance = 1.0f;
  })));
  m.environment(constantEnvironment(Vec3(1.0f)));
  m.camera(Vec3(0, inside ? 1.5f : 4.0f, 0.01f), Vec3(0.0f), 0.8f);
  return m.finish();
}

RenderResult pictureOf(Engine& engine, const ScenePtr& scene, const v1::RenderRequest& request) {
  RenderControl control;
  control.scene = scene;
  auto result = engine.render(request, control);
  EXPECT_TRUE(result.ok()) << result.status().toString();
  return result.ok() ? std::move(*result) : RenderResult{};
}

bool warns(const RenderResult& r, const std::string& text) {
  for (const std::string& warning : r.reply.warnings())
    if (warning == text) return true;
  return false;
}

TEST(EnvironmentInVolume, ACameraInsideOfOneHasTheMapPathTraced) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("aquarium", 16, 12, 64);
  set(r, "outputs=direct");
  const ScenePtr within = aquarium(true), outside = aquarium(false);
  const RenderResult truth = pictureOf(*engine, within, r);
  double mean = 0;
  for (const float v : truth.images[0].image().data) mean += double(v) / double(truth.images[0].image().data.size());
  EXPECT_GT(mean, 0.02);
  EXPECT_LT(mean, 0.5) << "of 0.6 without the volume";
  for (const auto& [field, asked] :
       {std::pair{"area_lights", "area_lights=4"}, std::pair{"extract_lights", "extract_lights=4"}, std::pair{"transfer", "transfer.points=300"}}) {
    v1::RenderRequest s = r;
    set(s, std::string("environment.") + asked);
    const std::string warning = std::string("environment.") + field + ": the camera is inside a volume: the map is path traced";
    const RenderResult picture = pictureOf(*engine, within, s);
    EXPECT_TRUE(warns(picture, warning)) << field;
    EXPECT_EQ(firstDifference(picture, truth), "") << field;
    EXPECT_FALSE(warns(pictureOf(*engine, outside, s), warning)) << field;
  }
}

// The transfer's rays take every surface for solid: under a pane there would be night.
TEST(EnvironmentInVolume, LightUnderAClearPaneIsNotTransfers) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("aquarium", 16, 12, 64);
  set(r, "outputs=direct");
  const ScenePtr scene = aquarium(false);  // seen through the box's lid
  const RenderResult truth = pictureOf(*engine, scene, r);
  set(r, "environment.transfer.points=300");
  const RenderResult picture = pictureOf(*engine, scene, r);
  EXPECT_TRUE(warns(picture, "environment.transfer: light passes some surfaces straight on (clear panes, volumes of index 1): the map is path traced"));
  EXPECT_EQ(firstDifference(picture, truth), "");
}

}  // namespace
}  // namespace gobo::testing::environment_in_volume_test

// SPDX-License-Identifier: Apache-2.0
// Interpolated normals under a lamp that the surface's own horizon cuts: unshadowed light is of what is above both normals, and so is the share of it that
// is seen. Nothing is in the way in these scenes; light that was taken off for the part below would be taken off twice.
#include <gtest/gtest.h>

#include <cmath>

#include "support/engines.h"
#include "support/tiny_scenes.h"

namespace gobo::testing::tilted_normals_test {
namespace {

/// A floor whose vertex normals lean by `degrees` towards a rectangle at its side that reaches as far below the floor as above.
ScenePtr leaning(double degrees) {
  tests::SceneMaker m;
  Mesh floor = tests::ground(1);
  const double a = degrees * M_PI / 180;
  floor.normals.assign(floor.positions.size(), Vec3(float(std::sin(a)), float(std::cos(a)), 0));
  m.instance(m.mesh(floor, m.material(Vec3(0.6f))));
  Light lamp;
  lamp.name = "lamp";
  lamp.shape.kind = LightKind::Rect;
  lamp.shape.position = Vec3(3, 0, 0);
  lamp.shape.axis = Vec3(-1, 0, 0);
  lamp.shape.u = Vec3(0, 0, 1);
  lamp.shape.v = Vec3(0, 1.5f, 0);
  lamp.power = Vec3(10);
  m.scene.lights.push_back(lamp);
  m.camera(Vec3(0, 3, 0.01f), Vec3(0.0f), 0.3f);
  return m.finish();
}

double mean(Engine& engine, const ScenePtr& scene, const std::string& assignment, int spp) {
  v1::RenderRequest r = smallRequest("by hand", 16, 12, spp);
  r.set_view_samples(4);
  set(r, "outputs=direct");
  if (!assignment.empty()) set(r, assignment);
  RenderControl control;
  control.scene = scene;
  const auto result = engine.render(r, control);
  EXPECT_TRUE(result.ok()) << result.status().toString();
  if (!result.ok()) return -1;
  double sum = 0;
  for (const float v : result->images[0].image().data) sum += v;
  return sum / double(result->images[0].image().data.size());
}

TEST(TiltedNormals, UnderACutLampLightIsNotTakenOffTwice) {
  const auto engine = makeEngine();
  for (const double degrees : {0.0, 10.0, 30.0, 50.0}) {
    const ScenePtr scene = leaning(degrees);
    const double truth = mean(*engine, scene, "", 1024);
    ASSERT_GT(truth, 0.01);
    for (const std::string technique : {"shadows.ray_traced.samples=64", "shadows.ray_traced.samples=1", "shadows.axis_aligned.k=3",
                                        "shadows.subtractive.resolution=1", "shadows.auto.error=0.02"})
      EXPECT_NEAR(mean(*engine, scene, technique, 4) / truth, 1, 0.01) << degrees << " degrees, " << technique;
  }
}

// What lies wholly below the surface is in shadow, whatever its normals say.
TEST(TiltedNormals, ALampBelowTheSurfaceIsNotSeen) {
  const auto engine = makeEngine();
  const ScenePtr scene = leaning(50);
  for (const std::string technique : {"shadows.ray_traced.samples=4", "shadows.axis_aligned.k=3"})
    for (const float below : {0.0f, 1.0f}) {
      v1::RenderRequest r = smallRequest("by hand", 16, 12, 1);
      for (const std::string& field : {technique, std::string("outputs=visibility:lamp"), "lights.lamp.position=3," + std::to_string(1.6f - 4 * below) + ",0"})
        set(r, field);
      RenderControl control;
      control.scene = scene;
      const auto result = engine->render(r, control);
      ASSERT_TRUE(result.ok()) << result.status().toString();
      for (const float v : result->images[0].image().data) ASSERT_EQ(v, 1.0f - below) << technique;
    }
}

}  // namespace
}  // namespace gobo::testing::tilted_normals_test

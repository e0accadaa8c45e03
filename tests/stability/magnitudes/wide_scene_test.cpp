// SPDX-License-Identifier: Apache-2.0
// Small things in wide scenes: a strip of 2 cm on a floor of 16 km has its shadow, by every technique that traces rays and under every kind of light. Rays
// that begin where rounding of the largest coordinate might put them, and not a thousandth of a percent of it away, are what it takes.
#include <gtest/gtest.h>

#include "support/engines.h"
#include "support/tiny_scenes.h"

namespace gobo::testing::wide_scene_test {
namespace {

ScenePtr strip() {
  tests::SceneMaker m;
  const int grey = m.material(Vec3(0.5f));
  m.instance(m.mesh(tests::ground(8000), grey));
  m.instance(m.mesh(tests::box(Vec3(-2, 0, -0.002f), Vec3(2, 0.02f, 0.002f)), grey));
  m.camera(Vec3(0, 1, 0), Vec3(0.0f));
  return m.finish();
}

/// Mean light on the floor, seen from above in a square of 6 cm about `z`; the strip is at 0.
double seen(Engine& engine, const ScenePtr& scene, const std::string& technique, const std::string& kind, double z) {
  v1::RenderRequest r = smallRequest("by hand", 8, 8, 4);
  r.mutable_integrator()->set_max_bounces(1);
  set(r, "camera.position=0,0.5," + std::to_string(z));
  set(r, "camera.look_at=0,0," + std::to_string(z));
  set(r, "camera.up=0,0,-1");
  set(r, "camera.orthographic_height=0.06");
  v1::ShadowTechnique& shadows = *r.mutable_shadows();
  shadows.GetReflection()->MutableMessage(&shadows, v1::ShadowTechnique::descriptor()->FindFieldByName(technique));
  // At ten degrees above the floor: the strip's shadow is 11 cm long.
  set(r, "lights.x.kind=" + kind);
  set(r, "lights.x.direction=0,-0.17632698,-1");
  set(r, "lights.x.intensity=100");
  if (kind != "DIRECTIONAL") set(r, "lights.x.position=0,1.7632698,10");
  for (const char* length : {"width", "height", "radius"}) set(r, std::string("lights.x.") + length + "=0.05");
  RenderControl control;
  control.scene = scene;
  const Result<RenderResult> result = engine.render(r, control);
  EXPECT_TRUE(result.ok()) << result.status().toString() << "\n" << messageToJson(r, false);
  if (!result.ok()) return -1;
  double sum = 0;
  const Image& picture = result->images[0].image();
  for (const float v : picture.data) sum += v;
  return sum / double(picture.data.size());
}

TEST(WideScene, SmallThingsHaveTheirShadows) {
  const auto engine = makeEngine();
  const ScenePtr scene = strip();
  for (const std::string technique : {"path_traced", "ray_traced", "axis_aligned", "subtractive", "auto"})
    for (const std::string kind : {"POINT", "SPOT", "DIRECTIONAL", "RECT", "DISK", "SPHERE"}) {
      SCOPED_TRACE(technique + ", " + kind);
      const double lit = seen(*engine, scene, technique, kind, 0.5), dark = seen(*engine, scene, technique, kind, -0.05);
      EXPECT_GT(lit, 1e-5);
      EXPECT_LT(dark, 1e-3 * lit);
    }
}

}  // namespace
}  // namespace gobo::testing::wide_scene_test

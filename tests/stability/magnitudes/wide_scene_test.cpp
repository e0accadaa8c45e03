// SPDX-License-Identifier: Apache-2.0
// Small things in wide scenes: a strip of 2 cm on a floor of 16 km has its shadow, by every technique that traces rays and under every kind of light. Rays
// that begin where rounding of the largest coordinate might put them, and not a thousandth of a percent of it away, are what it takes.
#include <gtest/gtest.h>

#include "scene/rig_sample.h"
#include "support/engines.h"
#include "support/tiny_scenes.h"

namespace gobo::testing::wide_scene_test {
namespace {

/// `beside`: the floor is of a metre, and a ground of 200 km lies below it.
ScenePtr strip(bool beside) {
  tests::SceneMaker m;
  const int grey = m.material(Vec3(0.5f));
  m.instance(m.mesh(tests::ground(beside ? 1.0f : 8000.0f), grey));
  if (beside) m.instance(m.mesh(tests::ground(1e5f, -5), grey));
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
  for (const bool beside : {false, true}) {
    const ScenePtr scene = strip(beside);
    for (const std::string technique : {"path_traced", "ray_traced", "axis_aligned", "subtractive", "auto"})
      for (const std::string kind : {"POINT", "SPOT", "DIRECTIONAL", "RECT", "DISK", "SPHERE"}) {
        SCOPED_TRACE(technique + ", " + kind + (beside ? ", wide ground beside" : ", wide floor"));
        const double lit = seen(*engine, scene, technique, kind, 0.5), dark = seen(*engine, scene, technique, kind, -0.05);
        EXPECT_GT(lit, 1e-5);
        EXPECT_LT(dark, 1e-3 * lit);
      }
  }
}

// Points of precomputed transfer are steps off their own instance too: a ceiling 2 cm above a floor lets no sky in, however wide the ground far below.
TEST(WideScene, TransferSeesWhatIsNearItsPoints) {
  const auto engine = makeEngine();
  const auto underCeiling = [&](float height) {
    tests::SceneMaker m;
    const int grey = m.material(Vec3(0.5f));
    m.instance(m.mesh(tests::ground(1.0f), grey));
    m.instance(m.mesh(tests::ground(1e5f, -5), grey));
    m.instance(m.mesh(tests::box(Vec3(-3, height, -3), Vec3(3, height + 0.001f, 3)), grey));
    m.camera(Vec3(0, 1, 0), Vec3(0.0f));
    v1::RenderRequest r = smallRequest("by hand", 8, 8, 4);
    for (const char* field : {"integrator.max_bounces=1", "environment.constant=1,1,1", "environment.transfer.points=2000", "camera.position=0,0.01,0",
                              "camera.look_at=0,0,0", "camera.up=0,0,-1", "camera.orthographic_height=1"})
      set(r, field);
    RenderControl control;
    control.scene = m.finish();
    const Result<RenderResult> result = engine->render(r, control);
    EXPECT_TRUE(result.ok()) << result.status().toString() << "\n" << messageToJson(r, false);
    if (!result.ok()) return -1.0;
    double sum = 0;
    for (const float v : result->images[0].image().data) sum += v;
    return sum / double(result->images[0].image().data.size());
  };
  const double open = underCeiling(1000.0f);
  EXPECT_GT(open, 0.45);
  EXPECT_LT(underCeiling(0.02f), 0.02 * open);
}

// A ball flattened by a scale of 0 has two layers: rays that leave one of them must be past the other.
TEST(WideScene, FlatNodesDoNotShadeThemselves) {
  const auto engine = makeEngine();
  const auto picture = [&](float thin) {
    tests::SceneMaker m;
    const Mat4 turned = glm::mat4_cast(glm::angleAxis(0.5f, glm::normalize(Vec3(1, 0.4f, 0.2f))));
    Mat4 flat = turned, toWorld;
    flat[1] *= thin;
    solidTransform(flat, toWorld);
    toWorld[3] = Vec4(0.1f, 0.3f, 0, 1);
    m.instance(m.mesh(tests::sphere(Vec3(0.0f), 1.0f, 24, true), m.material(Vec3(0.8f))), toWorld);
    m.camera(Vec3(0, 4, 2), Vec3(0.0f));
    v1::RenderRequest r = smallRequest("by hand", 96, 64, 64);
    for (const char* field : {"integrator.max_bounces=1", "camera.yfov_deg=35", "lights.x.kind=DIRECTIONAL", "lights.x.direction=-0.3,-1,-0.2",
                              "lights.x.intensity=3", "outputs=direct"})
      set(r, field);
    r.mutable_shadows()->mutable_path_traced();
    RenderControl control;
    control.scene = m.finish();
    Result<RenderResult> result = engine->render(r, control);
    EXPECT_TRUE(result.ok()) << result.status().toString();
    return result.ok() ? result->images[0].image() : Image(1, 1, 3);
  };
  const Image truth = picture(1e-4f), flat = picture(0.0f);
  ASSERT_EQ(truth.data.size(), flat.data.size());
  int off = 0, lit = 0;
  for (size_t i = 0; i < truth.data.size(); ++i) {
    lit += truth.data[i] > 0.1f;
    off += std::fabs(truth.data[i] - flat.data[i]) > 0.05f;
  }
  EXPECT_GT(lit, 1000);
  EXPECT_EQ(off, 0);
}

}  // namespace
}  // namespace gobo::testing::wide_scene_test

// SPDX-License-Identifier: Apache-2.0
// What subtractive shadows know of a map: unshadowed light and the few lights, against closed forms.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "subtractive_stage.h"
#include "support/map_of.h"
#include "techniques/subtractive/map_light.h"
#include "techniques/transfer/nodes.h"

namespace gobo::subtractive_test {
namespace {

TermPtr splitOf(Stage& s, const EnvironmentPtr& map, int lights = 0) {
  return s.run(transfer::makeEnvironmentSplitNode(map, subtractive::kBands, lights, 0.05), {});
}
/// What is the map's alone, however it is turned and whoever looks.
struct MapTerms {
  TermPtr split, gloss;
  MapTerms(Stage& s, const EnvironmentPtr& map) : split(splitOf(s, map)), gloss(s.run(transfer::makeGlossLevelsNode(map), {split})) {}
};
TermPtr unshadowedOf(Stage& s, const EnvironmentPtr& map, float rotation, const Vec3& scale, const MapTerms& of) {
  return s.run(subtractive::makeUnshadowedMapNode(s.view, map, rotation, scale, true), {s.g, s.surface, of.split, of.gloss});
}
TermPtr unshadowedOf(Stage& s, const EnvironmentPtr& map, float rotation, const Vec3& scale) { return unshadowedOf(s, map, rotation, scale, MapTerms(s, map)); }
std::vector<DistantLightSample> lightsOf(const TermPtr& list) {
  std::vector<DistantLightSample> out(size_t(list->extent().width));
  for (size_t i = 0; i < out.size(); ++i)
    out[i] = {subtractive::Receivers::at(list->floats("direction"), i), subtractive::Receivers::at(list->floats("irradiance"), i)};
  return out;
}

/// A white ball as it is seen from above or from below: together nearly every normal.
ScenePtr ballScene(bool below) {
  SceneMaker m;
  m.instance(m.mesh(tests::sphere(Vec3(0), 1.0f, 64, true), m.material(Vec3(1.0f))));
  m.camera(below ? Vec3(0.5f, -3, -3) : Vec3(0, 3, 3), Vec3(0), 0.6f);
  return m.finish();
}

TEST(SubtractiveMap, UniformRadianceIsReflectedByTheLobesAlbedos) {
  int shining = 0;
  double worst[2] = {0, 0};
  for (const ScenePtr& scene : {stageScene(), ballScene(false), ballScene(true)}) {
    Stage s(scene, 30, 22);
    const TermPtr light = unshadowedOf(s, constantEnvironment(Vec3(2.0f, 1.0f, 0.5f)), 0.3f, Vec3(1.0f, 3.0f, 1.0f));
    const subtractive::Receivers in(*s.g, *s.surface, s.view);
    for (size_t e = 0; e < in.instance.size(); ++e) {
      if (!in.lit(e)) continue;
      const LobeAlbedos by = in.albedos(e, in.bsdf(e));
      const float radiance[3] = {2.0f, 3.0f, 0.5f};
      for (size_t c = 0; c < 3; ++c) {
        worst[0] = std::max(worst[0], std::abs(double(light->floats("diffuse")[3 * e + c]) / radiance[c] - by.diffuse[int(c)]));
        worst[1] = std::max(worst[1], std::abs(double(light->floats("specular")[3 * e + c]) / radiance[c] - by.specular[int(c)]));
      }
      shining += by.specular.x > 0.1f;
    }
  }
  EXPECT_GT(shining, 30);
  RecordProperty("diffuse", std::to_string(worst[0]));
  EXPECT_LT(worst[0], 1e-3);
  EXPECT_LT(worst[1], 1e-6);
}

// One lit texel, turned: a light of one direction, whose irradiance is its flux times the cosine.
TEST(SubtractiveMap, ALampLiesWhereItLies) {
  double worst = 0;
  int seen = 0, dark = 0;
  Stage fromAbove(ballScene(false), 60, 60, 1), fromBelow(ballScene(true), 60, 60, 1);
  for (const int row : {20, 70, 127}) {
    const EnvironmentPtr map = tests::mapOf(512, 256, [&](int x, int y) { return Vec3(x == 300 && y == row ? 1000.0f : 0.0f); });
    const MapTerms terms(fromAbove, map);
    for (const bool below : {false, true})
      for (const float rotation : {0.9f, 0.0f, -2.3f}) {
        Stage& s = below ? fromBelow : fromAbove;
        auto turned = std::make_shared<Environment>(*map);
        turned->rotation = rotation;
        const Vec3 towards = turned->toDirection(Vec2(300.5f / 512, (float(row) + 0.5f) / 256));
        const double polar = (row + 0.5) * std::numbers::pi / 256;
        const double flux = 1000.0 * 4 * std::numbers::pi / 512 * std::sin(polar) * std::sin(std::numbers::pi / 512);
        const TermPtr light = unshadowedOf(s, map, rotation, Vec3(1.0f), terms);
        const subtractive::Receivers in(*s.g, *s.surface, s.view);
        for (size_t e = 0; e < in.instance.size(); ++e) {
          if (!in.lit(e)) continue;
          const double cosine = double(glm::dot(subtractive::Receivers::at(in.N, e), towards));
          worst = std::max(worst, std::abs(double(light->floats("diffuse")[3 * e]) / flux * std::numbers::pi - std::max(cosine, 0.0)));
          (cosine > 0 ? seen : dark)++;
        }
      }
  }
  EXPECT_GT(seen, 5000);
  EXPECT_GT(dark, 5000);
  RecordProperty("worst", std::to_string(worst));
  EXPECT_LT(worst, 0.013) << "of the irradiance of a plane that faces the lamp";
}

TEST(SubtractiveMap, FewLightsHaveTheFluxOfTheMapWithoutItsPeaks) {
  Stage s(floorScene([](SceneMaker&, int) {}), 2, 2);
  const EnvironmentPtr map = tests::mapOf(
      256, 128, [](int x, int y) { return x > 60 && x < 64 && y > 30 && y < 33 ? Vec3(4000, 3000, 2000) : Vec3(1.0f, 0.5f + 0.003f * float(y), 2.0f); });
  for (const int bright : {0, 4}) {
    const TermPtr split = splitOf(s, map, bright);
    EXPECT_EQ(split->plane<uint32_t>("count")[0], bright ? 1u : 0u);
    DVec3 flux(0.0), rest(0.0);
    for (const DistantLightSample& l : lightsOf(s.run(subtractive::makeResidualLightsNode(map, 50, ExtractBy::MedianCut), {split})))
      flux += DVec3(l.irradiance);
    for (int c = 0; c < 3; ++c) rest[c] = double(split->floats("rest")[size_t(c)]) * std::sqrt(4 * std::numbers::pi);  // of Y_0
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(flux[c] / rest[c], 1.0, 0.01) << bright << " " << c;
  }
}

// A wall without end hides half of a uniform sky from its foot: E = pi / 2.
TEST(SubtractiveMap, AtTheFootOfAWallHalfOfTheSkyIsSeen) {
  SceneMaker m;
  const int white = m.material(Vec3(0.8f));
  m.instance(m.mesh(tests::ground(4.0f), white));
  m.instance(m.mesh(tests::quad(Vec3(-4e4f, -1, -1), Vec3(8e4f, 0, 0), Vec3(0, 4e4f, 0)), white));
  m.camera(Vec3(0.1f, 3.0f, 0.5f), Vec3(0.1f, 0, -0.9999f), 1e-5f);
  Stage s(m.finish(), 2, 2);
  const EnvironmentPtr map = constantEnvironment(Vec3(1.0f));
  const TermPtr c = unshadowedOf(s, map, 0.0f, Vec3(1.0f));
  const auto lights = lightsOf(s.run(subtractive::makeResidualLightsNode(map, 256, ExtractBy::MedianCut), {splitOf(s, map)}));
  for (const Form form : kForms) {
    const TermPtr light = s.light(form, s.samples(lights, 1), c, int(lights.size()), 1);
    for (const float v : light->floats("diffuse")) EXPECT_NEAR(v / 0.4f, 1.0f, 0.03f) << int(form);
  }
}

}  // namespace
}  // namespace gobo::subtractive_test

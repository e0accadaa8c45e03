// SPDX-License-Identifier: Apache-2.0
#include "trace/light_tree.h"

#include <random>

#include "support/tiny_scenes.h"
#include "trace/light_selector.h"

namespace gobo::light_tree_test {
namespace {

using namespace tests;

Vec3 randomDirection(std::mt19937& g) {
  std::normal_distribution<float> n;
  return glm::normalize(Vec3(n(g), n(g), n(g)));
}
std::vector<LightBounds> randomLights(std::mt19937& g, int n) {
  std::uniform_real_distribution<float> u;
  std::vector<LightBounds> lights(n);
  for (LightBounds& b : lights) {
    const Vec3 p(10 * u(g), 10 * u(g), 10 * u(g));
    b.lo = p;
    b.hi = p + Vec3(u(g), u(g), u(g)) * 0.3f;
    b.axis = randomDirection(g);
    b.cosNormals = 1.0f - 0.5f * u(g);
    b.cosEmission = 0.3f * u(g);
    b.twoSided = u(g) < 0.2f;
    b.power = std::exp(4.0f * u(g));
  }
  return lights;
}

TEST(LightTree, ProbabilitiesSumToOneAndMatchTheDraws) {
  std::mt19937 g(1);
  std::uniform_real_distribution<float> u;
  const auto lights = randomLights(g, 37);
  LightTree tree;
  tree.build(lights);
  for (int trial = 0; trial < 20; ++trial) {
    const Vec3 p(12 * u(g) - 1, 12 * u(g) - 1, 12 * u(g) - 1), n = randomDirection(g);
    const Vec3* normal = trial % 2 ? &n : nullptr;
    double sum = 0;
    std::vector<double> probability(lights.size());
    for (size_t i = 0; i < lights.size(); ++i) sum += probability[i] = tree.probability(p, normal, int(i));
    const int draws = 20'000;
    std::vector<int> count(lights.size(), 0);
    int none = 0;
    for (int k = 0; k < draws; ++k) {
      float chance = -1;
      const int i = tree.sample(p, normal, (float(k) + u(g)) / draws, chance);
      if (i < 0) {
        ++none;
        continue;
      }
      ++count[i];
      ASSERT_NEAR(chance, tree.probability(p, normal, i), 1e-5 * chance);  // so that MIS weights add up to one
    }
    EXPECT_NEAR(sum, 1.0 - double(none) / draws, 2e-4);  // a branch may turn out empty below; then nothing is drawn
    for (size_t i = 0; i < lights.size(); ++i) EXPECT_NEAR(double(count[i]) / draws, probability[i], 4.5 * std::sqrt(probability[i] / draws) + 1e-3);
  }
}

TEST(LightTree, WithoutNormalsProbabilitiesSumToOneForOmniLights) {
  std::mt19937 g(2);
  std::uniform_real_distribution<float> u;
  std::vector<LightBounds> lights(100);
  for (LightBounds& b : lights) {
    b.lo = b.hi = Vec3(u(g), u(g), u(g));
    b.cosNormals = -1.0f;
    b.cosEmission = 0.0f;
    b.power = 1.0f + u(g);
  }
  LightTree tree;
  tree.build(lights);
  for (int trial = 0; trial < 50; ++trial) {
    const Vec3 p(3 * u(g) - 1, 3 * u(g) - 1, 3 * u(g) - 1);
    double sum = 0;
    for (size_t i = 0; i < lights.size(); ++i) sum += tree.probability(p, nullptr, int(i));
    EXPECT_NEAR(sum, 1.0, 1e-5);
  }
}

TEST(LightTree, NeverExcludesALightThatCanReachTheReceiver) {
  std::mt19937 g(3);
  std::uniform_real_distribution<float> u;
  const auto lights = randomLights(g, 60);
  LightTree tree;
  tree.build(lights);
  int reached = 0;
  for (int trial = 0; trial < 200'000; ++trial) {
    const size_t i = g() % lights.size();
    const LightBounds& b = lights[i];
    const Vec3 p(12 * u(g) - 1, 12 * u(g) - 1, 12 * u(g) - 1), n = randomDirection(g);
    const Vec3 q = b.lo + (b.hi - b.lo) * Vec3(u(g), u(g), u(g)), d = glm::normalize(p - q);
    // A normal of the light within its cone, and the angle between it and the way to the receiver.
    const float cosine = b.cosNormals + (1.0f - b.cosNormals) * u(g), sine = std::sqrt(std::max(0.0f, 1 - cosine * cosine)), phi = 6.2831853f * u(g);
    const Vec3 normal = Frame(b.axis).toWorld(Vec3(sine * std::cos(phi), sine * std::sin(phi), cosine));
    float towards = glm::dot(normal, d);
    if (b.twoSided) towards = std::fabs(towards);
    if (towards < b.cosEmission || glm::dot(n, -d) <= 0.0f) continue;
    ++reached;
    ASSERT_GT(tree.probability(p, &n, int(i)), 0.0f);
  }
  EXPECT_GT(reached, 10'000);
}

TEST(LightTree, PrefersTheNearLampByFar) {
  std::vector<LightBounds> lights(2);
  for (LightBounds& b : lights) {
    b.cosNormals = -1.0f;
    b.cosEmission = 0.0f;
    b.power = 1.0f;
  }
  lights[0].lo = lights[0].hi = Vec3(0, 1, 0);
  lights[1].lo = lights[1].hi = Vec3(10, 1, 0);
  LightTree tree;
  tree.build(lights);
  const Vec3 n(0, 1, 0);
  EXPECT_GT(tree.probability(Vec3(0.0f), &n, 0), 0.98f);
  EXPECT_EQ(tree.probability(Vec3(0, 2, 0), &n, 0), 0.0f);  // below the receiver's horizon
}

TEST(LightTree, ManyLightsInOnePlaceAndZeroPower) {
  std::vector<LightBounds> lights(9);
  for (size_t i = 0; i < lights.size(); ++i) {
    lights[i].lo = lights[i].hi = Vec3(1.0f);
    lights[i].cosNormals = -1;
    lights[i].cosEmission = 0;
    lights[i].power = i == 4 ? 0.0f : 1.0f;
  }
  LightTree tree;
  tree.build(lights);
  double sum = 0;
  for (int i = 0; i < 9; ++i) sum += tree.probability(Vec3(0.0f), nullptr, i);
  EXPECT_NEAR(sum, 1.0, 1e-6);
  EXPECT_EQ(tree.probability(Vec3(0.0f), nullptr, 4), 0.0f);
}

TEST(LightSelector, EveryStrategySumsToOneWithFiniteAndInfiniteLights) {
  SceneMaker m;
  m.instance(m.mesh(ground(5.0f), m.material(Vec3(0.5f))));
  LightShape point, sun, rect;
  point.position = Vec3(1, 2, 0);
  sun.kind = LightKind::Directional;
  rect.kind = LightKind::Rect;
  rect.position = Vec3(-1, 3, 0);
  m.light(point, Vec3(3.0f));
  m.light(sun, Vec3(2.0f));
  m.light(rect, Vec3(5.0f));
  m.environment(constantEnvironment(Vec3(0.5f)));
  m.camera(Vec3(0, 3, 3), Vec3(0.0f));
  const Traced t(m.finish());
  std::mt19937 g(4);
  std::uniform_real_distribution<float> u;
  for (const LightSelection mode : {LightSelection::Tree, LightSelection::Power, LightSelection::Uniform}) {
    LightSelector selector;
    std::vector<Vec3> nominal = t.settings.nominal;
    selector.build(t.view(), nominal, mode);
    EXPECT_EQ(selector.count(), 4);
    const Vec3 p(0.2f, 0, 0.1f), n(0, 1, 0);
    std::vector<double> count(4, 0);
    const int draws = 40'000;
    for (int i = 0; i < draws; ++i) {
      float chance;
      const int k = selector.sample(p, &n, (float(i) + u(g)) / draws, chance);
      ASSERT_GE(k, 0);
      ASSERT_FLOAT_EQ(chance, selector.probability(p, &n, k));
      count[k] += 1.0 / draws;
    }
    double sum = 0;
    for (int k = 0; k < 4; ++k) {
      const double chance = selector.probability(p, &n, k);
      sum += chance;
      EXPECT_NEAR(count[k], chance, 2e-3);
    }
    EXPECT_NEAR(sum, 1.0, 1e-5);
    nominal[0] = nominal[1] = nominal[3] = Vec3(0.0f);  // one light left: chosen without looking
    LightSelector one;
    one.build(t.view(), nominal, mode);
    EXPECT_EQ(one.count(), 1);
    EXPECT_EQ(one.probability(p, &n, 2), 1.0f);
    EXPECT_EQ(one.probability(p, &n, 0), 0.0f);
  }
}

TEST(LightTree, TheOnlyLightIsCertain) {
  std::mt19937 g(4);
  LightTree tree;
  tree.build(randomLights(g, 1));
  EXPECT_EQ(tree.probability(Vec3(0.0f), nullptr, 0), 1.0f);
  float probability = 0;
  EXPECT_EQ(tree.sample(Vec3(0.0f), nullptr, 0.3f, probability), 0);
  EXPECT_EQ(probability, 1.0f);
}

}  // namespace
}  // namespace gobo::light_tree_test

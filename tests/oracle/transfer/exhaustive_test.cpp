// SPDX-License-Identifier: Apache-2.0
// Direct light by every texel against closed forms and against the path tracer's own.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <numbers>

#include "plan/engine.h"
#include "support/engines.h"
#include "support/map_of.h"
#include "support/run_node.h"
#include "support/tiny_scenes.h"
#include "techniques/transfer/exhaustive_light.h"
#include "terms/gbuffer.h"

namespace gobo::transfer::exhaustive_test {
namespace {

using tests::SceneMaker;

ExhaustivePicture exhaustive(const Scene& scene, const Environment& map, int across, int width, int height, const Vec3& scale = Vec3(1.0f), int threads = 2,
                             const StopToken& stop = {}) {
  const TaskArena arena(threads);
  tests::NodeRunner run(scene, arena);
  GBufferSettings view;
  view.camera = scene.cameras[0];
  view.width = width;
  view.height = height;
  view.viewSamples = 1;
  const TermPtr g = run(makeGBufferNode(view), {});
  const auto sky = ExhaustiveSky::of(map, across, scale);
  EXPECT_TRUE(sky.ok()) << sky.status().toString();
  const std::vector<int> none;
  const SceneView seen(scene, kExhaustiveFacets, none);
  return exhaustivePicture(*sky, seen, Accel::build(seen, arena), *g, view.camera, arena, stop);
}
EnvironmentPtr constant(int width) {
  return tests::mapOf(width, width / 2, [](int, int) { return Vec3(2.0f, 1.0f, 0.25f); });
}
double solidAngleOf(const ExhaustiveSky& sky) {
  double sum = 0;
  for (const auto& d : sky.directions()) sum += double(d.irradiance.y);
  return sum;
}

TEST(ExhaustiveLight, DirectionsAreTheWholeSphere) {
  for (const auto& [width, across] : {std::pair(2, 1), std::pair(2, 16), std::pair(64, 4), std::pair(33, 3)}) {
    const auto sky = ExhaustiveSky::of(*constant(width), across);
    ASSERT_TRUE(sky.ok());
    EXPECT_EQ(sky->directions().size(), size_t(width) * size_t(width / 2) * size_t(across) * size_t(across));
    EXPECT_NEAR(solidAngleOf(*sky), 4 * std::numbers::pi, 1e-5);
    DVec3 balance(0.0);
    for (const auto& d : sky->directions()) {
      EXPECT_NEAR(glm::length(d.towards), 1.0f, 1e-6f);
      balance += double(d.irradiance.y) * DVec3(d.towards);
    }
    EXPECT_LT(glm::length(balance), 2e-4);
  }
  // Black texels cost nothing; the tents of a bright one reach half over its neighbours.
  const auto one = ExhaustiveSky::of(*tests::mapOf(16, 8, [](int x, int y) { return Vec3(x == 5 && y == 3 ? 1.0f : 0.0f); }), 4);
  ASSERT_TRUE(one.ok());
  EXPECT_LE(one->directions().size(), 64u);
  EXPECT_GE(one->directions().size(), 36u);
}

TEST(ExhaustiveLight, RefusesWhatItCannotHold) {
  for (const int across : {0, -3, 17}) EXPECT_EQ(ExhaustiveSky::of(*constant(8), across).status().code(), Code::InvalidArgument) << across;
  const auto large = ExhaustiveSky::of(*tests::mapOf(1024, 512, [](int, int) { return Vec3(0.0f); }), 16);
  ASSERT_FALSE(large.ok());
  EXPECT_NE(large.status().toString().find("134217728 directions"), std::string::npos) << large.status().toString();
}

// Radiance of a Lambert plane under radiance L is albedo x L in the open, and half of it at the foot of a wall without end.
TEST(ExhaustiveLight, OfAConstantMapIsTheClosedForm) {
  for (const bool wall : {false, true}) {
    SceneMaker m;
    const int grey = m.material(Vec3(0.5f, 0.8f, 1.0f));
    m.instance(m.mesh(tests::ground(4.0f), grey));
    if (wall) m.instance(m.mesh(tests::quad(Vec3(-4e4f, -1, -1), Vec3(8e4f, 0, 0), Vec3(0, 4e4f, 0)), grey));
    m.camera(Vec3(0.1f, 3.0f, 0.5f), Vec3(0.1f, 0, -0.9999f), 1e-5f);
    const ScenePtr scene = m.finish();
    for (const int across : {1, 4}) {
      const ExhaustivePicture picture = exhaustive(*scene, *constant(64), across, 2, 2);
      ASSERT_EQ(picture.diffuse.data.size(), 12u);
      for (size_t i = 0; i < picture.diffuse.data.size(); ++i) {
        const double expected = (wall ? 0.5 : 1.0) * std::array{0.5 * 2.0, 0.8 * 1.0, 1.0 * 0.25}[i % 3];
        EXPECT_NEAR(double(picture.diffuse.data[i]) / expected, 1.0, across == 1 ? 3e-3 : 2e-4) << wall << " " << across;
        EXPECT_EQ(picture.specular.data[i], 0.0f);
      }
    }
  }
}

// A wall of height h that runs on for ever to both sides, at distance d: it hides (1 - cos(a)) / 2 of the cosine's weight, tan(a) = h / d.
TEST(ExhaustiveLight, AWallHidesItsFormFactor) {
  for (const double angle : {0.3, 0.7, 1.2}) {
    SceneMaker m;
    const int white = m.material(Vec3(1.0f));
    m.instance(m.mesh(tests::ground(4.0f), white));
    m.instance(m.mesh(tests::quad(Vec3(-4e4f, -1, -1), Vec3(8e4f, 0, 0), Vec3(0, 1 + float(std::tan(angle)), 0)), white));
    m.camera(Vec3(0.0f, 8.0f, 0.01f), Vec3(0.0f, 0, 0.0f), 1e-6f);
    const ScenePtr scene = m.finish();
    const double expected = 0.25 * (1 - (1 - std::cos(angle)) / 2);
    EXPECT_NEAR(double(exhaustive(*scene, *constant(64), 4, 1, 1).diffuse.data[2]) / expected, 1.0, 3e-3) << angle;
  }
}

/// Dull and shining surfaces under one another, a tinted light, a map that is turned: a lamp of some texels over a coloured gradient.
ScenePtr stageOf() {
  SceneMaker m;
  const int grey = m.material(Vec3(0.6f)), shining = m.material(Vec3(0.8f, 0.3f, 0.2f), [](Material&x) {
    x.bsdf.specular = 1.0f;
    x.bsdf.roughness = 0.5f;
  });
  const int metal = m.material(Vec3(0.9f, 0.7f, 0.3f), [](Material& x) {
    x.bsdf = {};
    x.bsdf.metallic = 1.0f;
    x.bsdf.roughness = 0.6f;
  });
  m.instance(m.mesh(tests::ground(4.0f), grey));
  m.instance(m.mesh(tests::box(Vec3(-1, 0, -1), Vec3(0, 1.5f, 0)), shining));
  m.instance(m.mesh(tests::sphere(Vec3(0.8f, 0.6f, 0.5f), 0.6f, 24, true), metal));
  m.instance(
      m.mesh(tests::quad(Vec3(0.2f, 0.02f, 1.6f), Vec3(0.8f, 0, 0), Vec3(0, 0, -0.6f)), m.material(Vec3(0.5f), [](Material& x) { x.bsdf.unlit = true; })));
  auto map = std::make_shared<Environment>(*tests::mapOf(64, 32, [](int x, int y) {
    const bool lamp = x > 20 && x < 28 && y > 6 && y < 11;
    return Vec3(1.0f + 0.01f * float(x), 1.0f, 1.5f - 0.03f * float(y)) * (lamp ? 12.0f : 1.0f);
  }));
  map->rotation = 0.7f;
  m.environment(map, 1.0f);
  m.scene.lights[0].power = Vec3(1.5f, 1.0f, 0.5f);
  m.camera(Vec3(2.5f, 2.5f, 4.0f), Vec3(0, 0.5f, 0), 0.8f);
  return m.finish();
}

TEST(ExhaustiveLight, AgreesWithThePathTracer) {
  const ScenePtr scene = stageOf();
  constexpr int kWidth = 36, kHeight = 24;
  const auto engine = testing::makeEngine();
  v1::RenderRequest r = testing::smallRequest("stage", kWidth, kHeight, 1024);
  for (const char* e : {"view_samples=1", "integrator.max_bounces=0", "integrator.at_view_samples=true", "outputs=direct_diffuse,direct_specular"})
    testing::set(r, e);
  std::vector<RenderResult> halves;
  for (const char* seed : {"seed=1", "seed=2"}) {
    testing::set(r, seed);
    RenderControl control;
    control.scene = scene;
    auto result = engine->render(r, control);
    ASSERT_TRUE(result.ok()) << result.status().toString();
    ASSERT_EQ(result->images.size(), 2u);
    halves.push_back(std::move(*result));
  }
  double last[2] = {1, 1};
  for (const int across : {1, 4}) {
    const ExhaustivePicture picture = exhaustive(*scene, *scene->environment, across, kWidth, kHeight, scene->lights[0].power);
    EXPECT_GT(picture.rays, 100000u);
    for (const int lobe : {0, 1}) {
      const Image &own = lobe == 0 ? picture.diffuse : picture.specular, &a = halves[0].images[size_t(lobe)].image(),
                  &b = halves[1].images[size_t(lobe)].image();
      ASSERT_EQ(own.data.size(), a.data.size());
      double sum = 0, mean = 0, noise = 0, squares = 0;
      for (size_t i = 0; i < own.data.size(); ++i) {
        ASSERT_TRUE(std::isfinite(own.data[i]) && own.data[i] >= 0.0f);
        const double x = double(own.data[i]), p = double(a.data[i]), q = double(b.data[i]);
        sum += x;
        mean += 0.5 * (p + q);
        squares += (x - p) * (x - q);  // free of the tracer's noise
        noise += 0.25 * (p - q) * (p - q);
      }
      const double n = double(own.data.size()), error = std::sqrt(std::max(squares, 0.0) * n) / mean, uncertain = std::sqrt(noise) / mean;
      std::printf("  %d x %d, %s: mean / traced %.5f +- %.5f, RMSE %.4f of the mean\n", across, across, lobe == 0 ? "diffuse" : "specular", sum / mean,
                  uncertain, error);
      EXPECT_NEAR(sum / mean, 1.0, 3 * uncertain + (across == 1 ? 0.01 : 1e-3)) << across << " " << lobe;
      EXPECT_LT(error, across == 1 ? 0.06 : 0.015) << across << " " << lobe;
      EXPECT_LT(error, last[lobe]);  // more directions are nearer
      last[lobe] = error;
    }
  }
}

TEST(ExhaustiveLight, HasTheSameBitsForAnyNumberOfThreads) {
  const ScenePtr scene = stageOf();
  const ExhaustivePicture one = exhaustive(*scene, *scene->environment, 2, 20, 14, Vec3(1.0f), 1),
                          two = exhaustive(*scene, *scene->environment, 2, 20, 14, Vec3(1.0f), 2);
  EXPECT_EQ(one.rays, two.rays);
  EXPECT_EQ(std::memcmp(one.diffuse.data.data(), two.diffuse.data.data(), 4 * one.diffuse.data.size()), 0);
  EXPECT_EQ(std::memcmp(one.specular.data.data(), two.specular.data.data(), 4 * one.specular.data.size()), 0);
}

// One triangle, and maps of four texels: the least of both that there is.
TEST(ExhaustiveLight, OneTriangleUnderFourTexels) {
  SceneMaker m;
  Mesh triangle;
  triangle.positions = {Vec3(-2, 0, 2), Vec3(2, 0, 2), Vec3(0, 0, -3)};
  triangle.indices = {0, 1, 2};
  m.instance(m.mesh(std::move(triangle), m.material(Vec3(0.5f))));
  m.camera(Vec3(0, 4, 0.01f), Vec3(0.0f), 1e-4f);
  const ScenePtr scene = m.finish();
  // 4 x 1: nothing changes with height, and azimuth's mean is the texels'; midpoints of 8 steps down to the horizon sum to the cosine's integral over
  // cos(step / 2). 2 x 2: rows of 3 and 1 whose tents mix them by height: at polar angle t the look-up is 3 up to pi/4 and then 3 - 4 (t / pi - 1/4) to the
  // horizon, which the cosine weighs.
  const EnvironmentPtr row = tests::mapOf(4, 1, [](int x, int) { return Vec3(float(x)); });
  EXPECT_NEAR(double(exhaustive(*scene, *row, 16, 1, 1).diffuse.data[0]), 0.5 * 1.5 / std::cos(std::numbers::pi / 32), 1e-5);
  const EnvironmentPtr square = tests::mapOf(2, 2, [](int, int y) { return Vec3(y == 0 ? 3.0f : 1.0f); });
  double expected = 0;
  constexpr int kSteps = 20000;
  for (int k = 0; k < kSteps; ++k) {
    const double t = (k + 0.5) * std::numbers::pi / 2 / kSteps, value = t < std::numbers::pi / 4 ? 3.0 : 3.0 - 4.0 * (t / std::numbers::pi - 0.25);
    expected += value * std::sin(2 * t) * std::numbers::pi / 2 / kSteps;
  }
  EXPECT_NEAR(double(exhaustive(*scene, *square, 16, 1, 1).diffuse.data[0]), 0.5 * expected, 5e-3);
}

TEST(ExhaustiveLight, StopsWithoutAPicture) {
  const ScenePtr scene = stageOf();
  StopSource source;
  source.stop(StopReason::Cancelled);
  EXPECT_TRUE(exhaustive(*scene, *scene->environment, 4, 8, 8, Vec3(1.0f), 2, source.token()).diffuse.data.empty());
}

}  // namespace
}  // namespace gobo::transfer::exhaustive_test

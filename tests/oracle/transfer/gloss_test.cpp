// SPDX-License-Identifier: Apache-2.0
// Specular lobes under an environment by transfer: prefiltered levels against their integrals, pictures against path tracing.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "base/sobol.h"
#include "plan/engine.h"
#include "support/engines.h"
#include "support/thorough.h"
#include "support/tiny_scenes.h"
#include "techniques/transfer/gloss_levels.h"
#include "terms/environment_cells.h"
#include "trace/bsdf.h"

namespace gobo::transfer::gloss_test {
namespace {

using tests::SceneMaker;

constexpr size_t kCells = size_t(6) * EnvironmentCells::kSide * EnvironmentCells::kSide;
size_t floatsOf(const GlossLevel& l) { return size_t(3) * size_t(l.width) * size_t(l.height); }

std::vector<std::vector<float>> levelsOf(const Environment& map, const std::vector<float>& left) {
  const TaskArena arena(2);
  std::vector<std::vector<float>> out;
  for (size_t k = 0; k < kGlossLevels.size(); ++k) {
    out.emplace_back(floatsOf(kGlossLevels[k]));
    if (k == 0) EXPECT_TRUE(sharpLevel(map, left, arena, {}, out[0]));
    else EXPECT_TRUE(glossLevel(k, out[0], arena, {}, out[k]));
  }
  return out;
}
EnvironmentPtr smooth(int width) {
  Image image(width, width / 2, 3);
  for (int y = 0; y < width / 2; ++y)
    for (int x = 0; x < width; ++x) {
      const double theta = (y + 0.5) * std::numbers::pi / (width / 2), phi = (x + 0.5) * 2 * std::numbers::pi / width - std::numbers::pi;
      const double side = std::sin(theta) * std::cos(phi), ahead = std::sin(theta) * std::sin(phi), up = std::cos(theta);
      const double v = 1 + 0.7 * side + 0.5 * up * ahead + 0.6 * std::exp(6 * (0.6 * side + 0.8 * up - 1));
      for (size_t c = 0; c < 3; ++c) image.data[3 * size_t(y * width + x) + c] = float(v * (c == 1 ? 0.5 : 1.0));
    }
  return makeEnvironment("smooth", std::move(image));
}

TEST(GlossLevels, OfAConstantMapAreConstant) {
  const auto levels = levelsOf(*constantEnvironment(Vec3(3, 2, 1)), std::vector<float>(kCells, 1.0f));
  for (const auto& level : levels)
    for (size_t i = 0; i < level.size(); ++i) ASSERT_NEAR(level[i], 3.0f - float(i % 3), 2e-5f);
}

// Texels of maps that are no multiple of the level in size are neither lost nor counted twice.
TEST(GlossLevels, HaveAllOfMapsOfAnySize) {
  const auto solidAngle = [](int y, int columns, int rows) {
    return 2 * std::numbers::pi / columns * (std::cos(y * std::numbers::pi / rows) - std::cos((y + 1) * std::numbers::pi / rows));
  };
  const std::vector<float> all(kCells, 1.0f);
  const TaskArena arena(2);
  const int columns = kGlossLevels[0].width, rows = kGlossLevels[0].height;
  std::vector<float> level(floatsOf(kGlossLevels[0]));
  for (const auto& [width, height] : {std::pair{1000, 500}, std::pair{1920, 960}, std::pair{600, 200}, std::pair{1024, 512}}) {
    for (uint32_t lamp = 0; lamp < 8; ++lamp) {
      const Vec2 q = SobolSampler(11, lamp).next2D();
      const int x = std::min(int(q.x * float(width)), width - 1);
      const int y = lamp == 0 ? 0 : lamp == 1 ? height - 1 : std::min(int(q.y * float(height)), height - 1);
      Image image(width, height, 3);
      image.data[3 * (size_t(y) * size_t(width) + size_t(x))] = 1000.0f;
      ASSERT_TRUE(sharpLevel(*makeEnvironment("lamp", std::move(image)), all, arena, {}, level));
      double sum = 0;
      for (int v = 0; v < rows; ++v)
        for (int u = 0; u < columns; ++u) sum += solidAngle(v, columns, rows) * double(level[3 * (size_t(v) * size_t(columns) + size_t(u))]);
      EXPECT_NEAR(sum / (1000 * solidAngle(y, width, height)), 1.0, 0.02) << width << " x " << height << ", lamp at " << x << ", " << y;
    }
    Image image(width, height, 3);
    std::fill(image.data.begin(), image.data.end(), 2.5f);
    ASSERT_TRUE(sharpLevel(*makeEnvironment("constant", std::move(image)), all, arena, {}, level));
    for (const float v : level) ASSERT_NEAR(v, 2.5f, 1e-5f) << width << " x " << height;
  }
}

// Each level is the mean of the map by GGX's density over half vectors times the cosine: by 400 000 directions, cut off where it is (gloss_levels.cpp).
TEST(GlossLevels, AreTheirLobesMeans) {
  const EnvironmentPtr map = smooth(1024);
  const auto levels = levelsOf(*map, std::vector<float>(kCells, 1.0f));
  for (const float rotation : {0.0f, 1.3f}) {
    const GlossMap gloss([&](size_t k) { return std::span<const float>(levels[k]); }, rotation);
    Environment turned = *map;
    turned.rotation = rotation;
    for (size_t k = 0; k < kGlossLevels.size(); ++k)
      for (uint32_t place = 0; place < 12; ++place) {
        const Vec2 q = SobolSampler(7, place).next2D();
        const float z = place == 0 ? 1.0f : place == 1 ? -1.0f : 1 - 2 * q.x, r = std::sqrt(std::max(1 - z * z, 0.0f)), phi = 2 * kPi * q.y;
        const Vec3 axis(r * std::cos(phi), z, r * std::sin(phi));
        const Frame frame(axis);
        const double a = double(kGlossLevels[k].roughness) * double(kGlossLevels[k].roughness), cone = std::min(2 * std::atan(5 * a), std::numbers::pi / 2);
        DVec3 sum(0.0);
        double weight = 0;
        for (uint32_t i = 0; i < (k == 0 ? 1u : 40000u); ++i) {
          const Vec2 u = SobolSampler(place, i).next2D();
          const double most = 1 - std::cos(cone), c = k == 0 ? 1.0 : 1 - most * double(u.x), s = std::sqrt(std::max(1 - c * c, 0.0)),
                       b = 2 * double(kPi) * double(u.y);
          const double d = 0.5 * (1 + c) * (a * a - 1) + 1, w = k == 0 ? 1.0 : c / (d * d);
          sum += w * DVec3(turned.eval(glm::normalize(frame.toWorld(Vec3(float(s * std::cos(b)), float(s * std::sin(b)), float(c))))));
          weight += w;
        }
        const Vec3 found = gloss.at(axis, kGlossLevels[k].roughness);
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(found[c] / (sum[c] / weight), 1.0, 0.02) << "level " << k << " place " << place;
      }
  }
}

// Where a map is cut in two, a lobe beside the edge has of the bright half what of it reaches over, as far as it goes round.
TEST(GlossLevels, ReachAsFarAsTheirLobes) {
  Image image(1024, 512, 3);
  for (int y = 0; y < 512; ++y)
    for (int x = 0; x < 512; ++x)
      for (size_t c = 0; c < 3; ++c) image.data[3 * size_t(y * 1024 + x) + c] = 1.0f;
  const EnvironmentPtr map = makeEnvironment("halves", std::move(image));  // bright where z < 0
  const auto levels = levelsOf(*map, std::vector<float>(kCells, 1.0f));
  const GlossMap gloss([&](size_t k) { return std::span<const float>(levels[k]); }, 0.0f);
  for (size_t k = 2; k < kGlossLevels.size(); ++k) {
    const double a = double(kGlossLevels[k].roughness) * double(kGlossLevels[k].roughness), cone = std::min(2 * std::atan(5 * a), std::numbers::pi / 2);
    for (const double part : {0.35, 0.55, 0.75}) {
      const double off = part * cone;
      const Vec3 axis(float(std::cos(off)), 0.0f, float(std::sin(off)));
      const Frame frame(axis);
      double sum = 0, weight = 0;
      for (uint32_t i = 0; i < 60000; ++i) {
        const Vec2 u = SobolSampler(5, i).next2D();
        const double c = 1 - (1 - std::cos(cone)) * double(u.x), s = std::sqrt(std::max(1 - c * c, 0.0)), b = 2 * double(kPi) * double(u.y);
        const double d = 0.5 * (1 + c) * (a * a - 1) + 1, w = c / (d * d);
        sum += w * double(frame.toWorld(Vec3(float(s * std::cos(b)), float(s * std::sin(b)), float(c))).z < 0.0f);
        weight += w;
      }
      EXPECT_NEAR(double(gloss.at(axis, kGlossLevels[k].roughness).x), sum / weight, 0.06 * sum / weight + 0.002) << "level " << k << " off " << off;
    }
  }
}

TEST(GlossLevels, LeaveOutWhatLightsTook) {
  const EnvironmentPtr map = constantEnvironment(Vec3(1.0f));
  std::vector<float> left(kCells, 1.0f);
  for (size_t i = 0; i < kCells; ++i)
    if (EnvironmentCells::cellDirection(i).y > 0) left[i] = 0.25f;
  const auto levels = levelsOf(*map, left);
  const GlossMap gloss([&](size_t k) { return std::span<const float>(levels[k]); }, 0.0f);
  EXPECT_NEAR(gloss.at(Vec3(0, 1, 0), 0.0f).x, 0.25f, 1e-4f);
  EXPECT_NEAR(gloss.at(Vec3(0, -1, 0), 0.3f).x, 1.0f, 1e-4f);
  EXPECT_NEAR(gloss.at(glm::normalize(Vec3(1, 0, 0.2f)), 0.5f).x, 0.625f, 0.02f);
}

TEST(LobeAlbedos, AreWhatTheLobesReflectOfUniformLight) {
  for (const float metallic : {0.0f, 0.4f, 1.0f})
    for (const float roughness : {0.15f, 0.4f, 0.8f, 1.0f})
      for (const float specular : {0.0f, 0.5f, 1.0f})
        for (const float mu : {0.1f, 0.45f, 0.9f}) {
          BsdfParams p;
          p.albedo = Vec3(0.9f, 0.5f, 0.1f);
          p.metallic = metallic;
          p.roughness = roughness;
          p.specular = specular;
          p.ior = 1.7f;
          const LobeAlbedos found = bsdfLobeAlbedos(p, mu);
          const Vec3 wo(std::sqrt(1 - mu * mu), 0, mu);
          DVec3 diffuse(0.0), specularSum(0.0);
          const uint32_t n = 1 << 14;
          for (uint32_t i = 0; i < n; ++i) {
            SobolSampler random(3, i);
            BsdfSample s;
            const float lobe = random.next1D();
            if (!bsdfSample(p, wo, lobe, random.next2D(), s) || !(s.pdf > 0)) continue;
            const BsdfValue f = bsdfEval(p, wo, s.wi);
            diffuse += DVec3(f.diffuse) / double(s.pdf);
            specularSum += DVec3(f.specular) / double(s.pdf);
          }
          for (int c = 0; c < 3; ++c) {
            // Tables are within 0.003 of the lobes, the lobes within 1 % of each other's energy (docs/materials.md).
            EXPECT_NEAR(found.diffuse[c], diffuse[c] / n, 0.013) << metallic << " " << roughness << " " << specular << " " << mu;
            EXPECT_NEAR(found.specular[c], specularSum[c] / n, 0.013) << metallic << " " << roughness << " " << specular << " " << mu;
          }
        }
}

// The highlight of a rough dielectric is a hundredth of the map: what its table is padded with would be a tenth of that.
TEST(LobeAlbedos, OfRoughDielectricsAreNotPadded) {
  for (const float roughness : {0.6f, 0.8f, 1.0f})
    for (const float mu : {0.4f, 0.7f, 0.95f}) {
      BsdfParams p;
      p.albedo = Vec3(0.0f);
      p.metallic = 0;
      p.roughness = roughness;
      const float found = bsdfLobeAlbedos(p, mu).specular.x;
      const Vec3 wo(std::sqrt(1 - mu * mu), 0, mu);
      double sum = 0;  // over the hemisphere by the midpoint rule in cosine squared and angle
      constexpr int kRings = 400, kSides = 400;
      for (int i = 0; i < kRings; ++i)
        for (int k = 0; k < kSides; ++k) {
          const float sine2 = (float(i) + 0.5f) / kRings, a = 2 * kPi * (float(k) + 0.5f) / kSides, sine = std::sqrt(sine2);
          const Vec3 wi(sine * std::cos(a), sine * std::sin(a), std::sqrt(1 - sine2));
          sum += double(bsdfEval(p, wo, wi).specular.x) / double(wi.z);
        }
      EXPECT_NEAR(found, sum * double(kPi) / (kRings * kSides), 5e-4) << roughness << " " << mu;
    }
}

RenderResult pictureOf(Engine& engine, const ScenePtr& scene, const v1::RenderRequest& request) {
  RenderControl control;
  control.scene = scene;
  auto result = engine.render(request, control);
  EXPECT_TRUE(result.ok()) << result.status().toString();
  return result.ok() ? std::move(*result) : RenderResult{};
}
struct Difference {
  double mean, rmse;  // of the mean of the truth
};
Difference differenceOf(const Image& a, const Image& truth) {
  double mean = 0, own = 0, square = 0;
  for (size_t i = 0; i < a.data.size(); ++i) {
    mean += double(truth.data[i]);
    own += double(a.data[i]);
    square += std::pow(double(a.data[i]) - double(truth.data[i]), 2);
  }
  return {own / mean, std::sqrt(square * double(a.data.size())) / mean};
}
v1::RenderRequest requestOf(int spp) {
  v1::RenderRequest r = testing::smallRequest("gloss", 48, 36, spp);
  r.set_view_samples(4);
  r.mutable_integrator()->set_max_bounces(3);
  return r;
}
/// Of the picture by transfer from the path tracer's.
Difference differenceFor(Engine& engine, const ScenePtr& scene, double turn = 0) {
  v1::RenderRequest r = requestOf(256);
  testing::set(r, "environment.rotation_deg=" + std::to_string(turn));
  const RenderResult truth = pictureOf(engine, scene, r);
  for (const char* e : {"environment.transfer.samples=1024", "environment.transfer.points=6000", "environment.transfer.gloss=PREFILTERED"}) testing::set(r, e);
  return differenceOf(pictureOf(engine, scene, r).images[0].image(), truth.images[0].image());
}

// Nothing stands in the light: a ball reflects its albedo.
TEST(GlossPictures, ABallUnderUniformLightShowsItsAlbedo) {
  const auto engine = testing::makeEngine();
  for (const float roughness : {0.05f, 0.3f, 0.9f})
    for (const float metallic : {0.0f, 1.0f}) {
      if (!testing::thorough() && (roughness == 0.3f) == (metallic > 0)) continue;  // every roughness, metal and plastic
      SceneMaker m;
      m.instance(m.mesh(tests::sphere(Vec3(0.0f), 1.0f, 32, true), m.material(Vec3(0.8f, 0.4f, 0.2f), [&](Material& x) {
        x.bsdf.specular = 1.0f;
        x.bsdf.metallic = metallic;
        x.bsdf.roughness = roughness;
      })));
      m.environment(constantEnvironment(Vec3(1.0f)));
      m.camera(Vec3(0, 0, 4), Vec3(0.0f), 0.4f);
      const Difference d = differenceFor(*engine, m.finish());
      EXPECT_NEAR(d.mean, 1.0, 0.012) << roughness << " " << metallic;
      EXPECT_LT(d.rmse, 0.05) << roughness << " " << metallic;
    }
}

// Coarse balls look below their own facets at the rim: that light is mirrored back (trace/bsdf.h), or the rim would be dark.
TEST(GlossPictures, ACoarseBallIsAsBrightAsItsAlbedo) {
  const auto engine = testing::makeEngine();
  SceneMaker m;
  m.instance(m.mesh(tests::sphere(Vec3(0.0f), 1.0f, 5, true), m.material(Vec3(0.8f), [&](Material& x) {
    x.bsdf.specular = 1.0f;
    x.bsdf.metallic = 1.0f;
    x.bsdf.roughness = 0.1f;
  })));
  m.environment(constantEnvironment(Vec3(1.0f)));
  m.camera(Vec3(0, 0, 4), Vec3(0.0f), 0.4f);
  const Difference d = differenceFor(*engine, m.finish());
  std::printf("  coarse ball: mean %.4f, rmse %.4f of the mean\n", d.mean, d.rmse);
  EXPECT_NEAR(d.mean, 1.0, 0.012);
  EXPECT_LT(d.rmse, 0.045);
}

/// Metal of roughness 0.2.
int metal(SceneMaker& m) {
  return m.material(Vec3(0.9f), [](Material& x) {
    x.bsdf.specular = 1.0f;
    x.bsdf.metallic = 1.0f;
    x.bsdf.roughness = 0.2f;
  });
}

TEST(GlossPictures, ABallShowsTheMapAsItIsTurned) {
  const auto engine = testing::makeEngine();
  SceneMaker m;
  m.instance(m.mesh(tests::sphere(Vec3(0.0f), 1.0f, 32, true), metal(m)));
  m.environment(smooth(256));
  m.camera(Vec3(0, 0, 4), Vec3(0.0f), 0.4f);
  const Difference d = differenceFor(*engine, m.finish(), 70);
  EXPECT_NEAR(d.mean, 1.0, 0.02);
  EXPECT_LT(d.rmse, 0.075);
}

// Normals that lean away from who looks along a floor mirror him to below it: that light is mirrored back, and comes from the bright half of the map.
TEST(GlossPictures, LightFromBelowTheFloorIsThatFromAbove) {
  const auto engine = testing::makeEngine();
  Image image(64, 32, 3);
  std::fill(image.data.begin(), image.data.begin() + 3 * 64 * 16, 1.0f);
  Mesh floor = tests::ground(2.0f);
  floor.normals = Array<Vec3>(std::vector<Vec3>(4, glm::normalize(Vec3(0, 1, -0.6f))));
  SceneMaker m;
  m.instance(m.mesh(std::move(floor), metal(m)));
  m.environment(makeEnvironment("above", std::move(image)));
  m.camera(Vec3(0, 0.7f, 2.0f), Vec3(0, 0, 0.5f), 0.5f);
  m.scene.lights.back().cameraVisible = false;
  const Difference d = differenceFor(*engine, m.finish());
  std::printf("  floor: mean %.3f, rmse %.3f of the mean\n", d.mean, d.rmse);
  EXPECT_NEAR(d.mean, 1.0, 0.05);
}

// A smooth floor beside a white wall, seen from the wall's side: it shows the dark sky that it looks at, though the wall lights it.
TEST(GlossPictures, AFloorBesideAWallShowsWhatItLooksAt) {
  const auto engine = testing::makeEngine();
  Image image(64, 32, 3);
  for (int y = 0; y < 32; ++y)
    for (int x = 0; x < 32; ++x)
      for (size_t c = 0; c < 3; ++c) image.data[3 * size_t(y * 64 + x) + c] = 1.0f;  // bright where z < 0, which the wall faces
  for (float& v : image.data) v += 0.05f;
  SceneMaker m;
  m.instance(m.mesh(tests::ground(3.0f), metal(m)));
  m.instance(m.mesh(tests::quad(Vec3(-3, 0, 1.0f), Vec3(0, 3, 0), Vec3(6, 0, 0)), m.material(Vec3(0.9f))));
  m.environment(makeEnvironment("halves", std::move(image)));
  m.camera(Vec3(0, 0.8f, 0.9f), Vec3(0.0f), 0.5f);
  const Difference d = differenceFor(*engine, m.finish());
  EXPECT_NEAR(d.mean, 1.0, 0.02);
  EXPECT_LT(d.rmse, 0.03);
}

// What it is off by in a yard, where the scene shows in its own surfaces: bounds are what docs/environment.md states.
TEST(GlossPictures, AYardIsNearThePathTracers) {
  const auto engine = testing::makeEngine();
  for (const float roughness : {0.3f, 0.6f})
    for (const float metallic : {0.0f, 1.0f}) {
      if (!testing::thorough() && (roughness > 0.5f) == (metallic > 0)) continue;  // every roughness, metal and plastic
      SceneMaker m;
      const auto shine = [&](Material& x) {
        x.bsdf.specular = 1.0f;
        x.bsdf.metallic = metallic;
        x.bsdf.roughness = roughness;
      };
      m.instance(m.mesh(tests::ground(4.0f), m.material(Vec3(0.5f), shine)));
      m.instance(m.mesh(tests::box(Vec3(-1, 0, -1), Vec3(0, 1.5f, 0)), m.material(Vec3(0.6f, 0.2f, 0.1f), shine)));
      m.instance(m.mesh(tests::sphere(Vec3(0.8f, 0.6f, 0.5f), 0.6f, 24, true), m.material(Vec3(0.7f), shine)));
      m.environment(smooth(256));
      m.camera(Vec3(2.5f, 2.5f, 4.0f), Vec3(0, 0.5f, 0), 0.8f);
      const Difference d = differenceFor(*engine, m.finish());
      std::printf("  roughness %.1f metallic %.0f: mean %.3f, rmse %.3f of the mean\n", double(roughness), double(metallic), d.mean, d.rmse);
      EXPECT_NEAR(d.mean, 1.0, metallic > 0 ? 0.06 : 0.03) << roughness << " " << metallic;
      EXPECT_LT(d.rmse, metallic > 0 ? 0.2 : 0.08) << roughness << " " << metallic;
    }
}

}  // namespace
}  // namespace gobo::transfer::gloss_test

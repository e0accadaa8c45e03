// SPDX-License-Identifier: Apache-2.0
// A map's unshadowed light by nine harmonics and by a radiance cache, against closed forms and the house's BSDF summed over the map.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>

#include "subtractive_stage.h"
#include "support/map_of.h"
#include "support/thorough.h"
#include "techniques/subtractive/cached_map.h"
#include "techniques/subtractive/map_light.h"
#include "techniques/transfer/nodes.h"

namespace gobo::subtractive_test {
namespace unshadowed_test {

using subtractive::DiffuseBy;
using subtractive::RadianceCacheSettings;
using subtractive::Receivers;

/// One ball that reflects.
ScenePtr ball(const std::function<void(Material&)>& change, const Vec3& from = Vec3(0, 2, 4), const Vec3& to = Vec3(0), float yfov = 0.5f, bool flat = false) {
  SceneMaker m;
  m.instance(m.mesh(tests::sphere(Vec3(0), 1.0f, 64, true), m.material(Vec3(0.9f, 0.5f, 0.2f), change)));
  m.camera(from, to, yfov);
  if (flat) m.scene.cameras[0].perspective = false, m.scene.cameras[0].yheight = 2.1f;
  return m.finish();
}
std::function<void(Material&)> metalOf(float roughness) {
  return [roughness](Material& m) { m.bsdf = {}, m.bsdf.metallic = 1.0f, m.bsdf.roughness = roughness; };
}
std::function<void(Material&)> plasticOf(float roughness) {
  return [roughness](Material& m) { m.bsdf = {}, m.bsdf.roughness = roughness; };
}

/// Smooth in all directions: waves of some directions, of 10 degrees and more.
EnvironmentPtr waves(int seed) {
  return tests::mapOf(256, 128, [seed](int x, int y) {
    const double theta = (y + 0.5) * std::numbers::pi / 128, phi = ((x + 0.5) / 256 * 2 - 1) * std::numbers::pi;
    const DVec3 d(std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi));
    DVec3 sum(1.2);
    for (int k = 0; k < 6; ++k) {
      const DVec3 axis(std::sin(1.3 * k + seed), std::cos(2.1 * k + seed), std::sin(3.7 * k + 2 * seed));
      for (int c = 0; c < 3; ++c) sum[c] += 0.35 * std::sin((2.0 + k) * glm::dot(axis, d) + c + seed);
    }
    return Vec3(glm::max(sum, DVec3(0.05)));
  });
}

/// Roots of mean squares of what is wrong with each lobe, by those of its light; and of specular light by the map's mean radiance, about 1.2.
struct Errors {
  double diffuse = 0, specular = 0, ofRadiance = 0;
};

struct Sky {
  Stage& s;
  EnvironmentPtr map;
  float rotation = 0;
  Vec3 scale{1.0f};
  TermPtr split() { return s.run(transfer::makeEnvironmentSplitNode(map, subtractive::kBands, 0, 0.05), {}); }
  TermPtr prefiltered(DiffuseBy by) {
    const TermPtr from = split();
    return s.run(subtractive::makeUnshadowedMapNode(s.view, map, rotation, scale, true, by),
                 {s.g, s.surface, from, s.run(transfer::makeGlossLevelsNode(map), {from})});
  }
  RadianceCacheSettings settings() {
    RadianceCacheSettings c{map, subtractive::toMapAxes(Vec3(s.view.camera.toWorld[2]), rotation)};
    c.roughness = subtractive::cachedRoughnesses(*s.scene);
    return c;
  }
  TermPtr tables(const RadianceCacheSettings& c) { return s.run(subtractive::makeRadianceCacheNode(c), {split()}); }
  TermPtr cached(const RadianceCacheSettings& c, const TermPtr& from) {
    return s.run(subtractive::makeCachedMapNode(s.view, c, rotation, scale), {s.g, s.surface, from});
  }
  TermPtr cached(const RadianceCacheSettings& c) { return cached(c, tables(c)); }
  TermPtr cached(int side = subtractive::kCacheSide) {
    RadianceCacheSettings c = settings();
    c.side = side;
    return cached(c);
  }

  /// The map as directions and the irradiance from each, of a surface across it.
  const std::vector<std::pair<Vec3, DVec3>>& lights() {
    constexpr int W = 384, H = 192;
    if (!lights_.empty()) return lights_;
    auto turned = std::make_shared<Environment>(*map);
    turned->rotation = rotation;
    for (int y = 0; y < H; ++y) {
      const double theta = (y + 0.5) * std::numbers::pi / H, angle = 4 * std::numbers::pi / W * std::sin(theta) * std::sin(std::numbers::pi / (2 * H));
      for (int x = 0; x < W; ++x) {
        const double phi = (x + 0.5) * 2 * std::numbers::pi / W;
        const Vec3 d(DVec3(std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi)));
        lights_.emplace_back(d, angle * DVec3(turned->eval(d) * scale));
      }
    }
    return lights_;
  }
  /// Sum over the map of the material's own light, without a mirror at the facet.
  BsdfValue exact(size_t e) {
    const Receivers in(*s.g, *s.surface, s.view);
    const Frame frame(Receivers::at(in.N, e));
    const BsdfParams b = in.bsdf(e);
    const Vec3 wo = frame.toLocal(in.out(e));
    DVec3 sum[2] = {DVec3(0.0), DVec3(0.0)};
    for (const auto& [d, light] : lights()) {
      if (!(d.x * frame.z.x + d.y * frame.z.y + d.z * frame.z.z > 0)) continue;
      const BsdfValue f = bsdfEval(b, wo, frame.toLocal(d));
      sum[0] += DVec3(f.diffuse) * light;
      sum[1] += DVec3(f.specular) * light;
    }
    return {Vec3(sum[0]), Vec3(sum[1])};
  }
  /// Over every n-th sample. `cosine`: least one of the viewer.
  Errors error(const TermPtr& light, size_t n, float cosine = 0.1f) {
    const Receivers in(*s.g, *s.surface, s.view);
    double wrong[2] = {0, 0}, all[2] = {0, 0};
    size_t count = 0;
    for (size_t e = 0; e < in.instance.size(); ++e) {
      if (!in.lit(e) || glm::dot(Receivers::at(in.N, e), in.out(e)) < cosine || count++ % n != 0) continue;
      const BsdfValue truth = exact(e);
      for (size_t k = 0; k < 2; ++k)
        for (size_t c = 0; c < 3; ++c) {
          const double t = double((k ? truth.specular : truth.diffuse)[int(c)]), v = double(light->floats(k ? "specular" : "diffuse")[3 * e + c]);
          wrong[k] += (v - t) * (v - t);
          all[k] += t * t;
        }
    }
    EXPECT_GT(count / n, 10u);
    const double of = 1.2 * std::sqrt(3.0 * double((count + n - 1) / n) * double(glm::dot(scale, scale)) / 3.0);
    return {all[0] > 0 ? std::sqrt(wrong[0] / all[0]) : 0.0, all[1] > 0 ? std::sqrt(wrong[1] / all[1]) : 0.0, std::sqrt(wrong[1]) / of};
  }
  std::vector<std::pair<Vec3, DVec3>> lights_ = {};
};

// A quadratic of the cosine, as the paper has it; what it has below zero is cut off.
TEST(SubtractiveHarmonics, OneLampIsTheirQuadraticAndNeverNegative) {
  double worst = 0, most = 0;
  int cut = 0;
  for (const bool below : {false, true})
    for (const float rotation : {0.0f, 1.1f}) {
      Stage s(ball({}, below ? Vec3(0.5f, -3, -3) : Vec3(0, 3, 3), Vec3(0), 0.6f), 50, 50, 1);
      const EnvironmentPtr map = tests::mapOf(512, 256, [](int x, int y) { return Vec3(x == 140 && y == 60 ? 1000.0f : 0.0f); });
      auto turned = std::make_shared<Environment>(*map);
      turned->rotation = rotation;
      const Vec3 towards = turned->toDirection(Vec2(140.5f / 512, 60.5f / 256));
      const double flux = 1000.0 * 4 * std::numbers::pi / 512 * std::sin(60.5 * std::numbers::pi / 256) * std::sin(std::numbers::pi / 512);
      Sky sky{s, map, rotation};
      const TermPtr light = sky.prefiltered(DiffuseBy::Harmonics);
      const Receivers in(*s.g, *s.surface, s.view);
      for (size_t e = 0; e < in.instance.size(); ++e) {
        if (!in.lit(e)) continue;
        const double x = double(glm::dot(Receivers::at(in.N, e), towards)), expected = 0.25 * (0.375 + 2 * x + 1.875 * x * x);
        const double relative = double(light->floats("diffuse")[3 * e]) / (flux * std::numbers::inv_pi * double(in.albedo[3 * e]));
        if (expected < -1e-3) {
          ASSERT_EQ(relative, 0.0) << x;
          ++cut;
        }
        most = std::max(most, relative);
        worst = std::max(worst, std::abs(relative - std::max(expected, 0.0)));
      }
    }
  EXPECT_GT(cut, 300);
  EXPECT_GT(most, 1.05);
  RecordProperty("worst", std::to_string(worst));
  EXPECT_LT(worst, 2e-3) << "of the irradiance of a plane that faces the lamp";
}

TEST(SubtractiveHarmonics, UniformRadianceIsExactAndHighlightsAreThePrefilteredOnes) {
  Stage s(stageScene(), 30, 22);
  Sky sky{s, constantEnvironment(Vec3(2.0f, 1.0f, 0.5f)), 0.3f, Vec3(1.0f, 3.0f, 1.0f)};
  const TermPtr light = sky.prefiltered(DiffuseBy::Harmonics), table = sky.prefiltered(DiffuseBy::Table);
  const Receivers in(*s.g, *s.surface, s.view);
  const float radiance[3] = {2.0f, 3.0f, 0.5f};
  for (size_t e = 0; e < in.instance.size(); ++e) {
    if (!in.lit(e)) continue;
    const LobeAlbedos by = in.albedos(e, in.bsdf(e));
    for (size_t c = 0; c < 3; ++c) {
      EXPECT_NEAR(light->floats("diffuse")[3 * e + c] / radiance[c], by.diffuse[int(c)], 1e-6f);
      EXPECT_EQ(light->floats("specular")[3 * e + c], table->floats("specular")[3 * e + c]);
    }
  }
}

// Every field of view: what is looked up are means.
TEST(SubtractiveCache, UniformRadianceIsReflectedByTheLobesAlbedos) {
  int shining = 0;
  double worst = 0;
  for (const ScenePtr& scene :
       {stageScene(), ball(plasticOf(0.3f), Vec3(0, 0.3f, 1.3f), Vec3(0), 1.9f), ball(metalOf(1.0f)), ball(plasticOf(0.0f)), ball({})}) {
    Stage s(scene, 30, 22);
    Sky sky{s, constantEnvironment(Vec3(2.0f, 1.0f, 0.5f)), 0.3f, Vec3(1.0f, 3.0f, 1.0f)};
    const TermPtr light = sky.cached(24);
    const Receivers in(*s.g, *s.surface, s.view);
    const float radiance[3] = {2.0f, 3.0f, 0.5f};
    for (size_t e = 0; e < in.instance.size(); ++e) {
      if (!in.lit(e)) continue;
      const LobeAlbedos by = in.albedos(e, in.bsdf(e));
      const bool mirror = sqr(in.bsdf(e).roughness) < kDeltaAlpha;
      for (size_t c = 0; c < 3; ++c) {
        worst = std::max(worst, std::abs(double(light->floats("diffuse")[3 * e + c]) / radiance[c] - by.diffuse[int(c)]));
        worst = std::max(worst, std::abs(double(light->floats("specular")[3 * e + c]) / radiance[c] - (mirror ? 0.0f : by.specular[int(c)])));
      }
      shining += by.specular.x > 0.1f;
    }
  }
  EXPECT_GT(shining, 100);
  RecordProperty("worst", std::to_string(worst));
  EXPECT_LT(worst, 1e-3);
}

// Of a distant eye it is what the material reflects of the map, both lobes, horizon and all. What the tables of albedos lack of Schlick's term, 0.003 of the
// radiance (trace/bsdf_albedo.h), is much of what little a rough dielectric mirrors.
TEST(SubtractiveCache, OfADistantEyeItIsTheMaterialsIntegral) {
  const EnvironmentPtr map = waves(3);
  for (const auto& [roughness, rotation] : {std::pair(0.25f, 0.0f), std::pair(0.5f, -0.8f), std::pair(1.0f, 0.0f)}) {
    TermPtr tables;  // both materials' own
    std::vector<float> levels;
    for (const bool metal : {true, false}) {
      Stage s(ball(metal ? metalOf(roughness) : plasticOf(roughness), Vec3(1, 2, 4), Vec3(0), 0.5f, true), 24, 24, 1);
      Sky sky{s, map, rotation, Vec3(1.0f, 2.0f, 0.5f)};
      const RadianceCacheSettings c = sky.settings();
      if (!tables) tables = sky.tables(c), levels = c.roughness;
      ASSERT_EQ(c.roughness, levels);
      const Errors e = sky.error(sky.cached(c, tables), 17);
      std::printf("%s of roughness %.2f, turned %.1f: RMS error of diffuse light %.5f, of specular light %.5f (%.5f of the radiance)\n",
                  metal ? "metal" : "plastic", double(roughness), double(rotation), e.diffuse, e.specular, e.ofRadiance);
      EXPECT_LT(e.diffuse, 0.005);
      EXPECT_LT(metal ? e.specular : 0.0, 0.01);
      EXPECT_LT(e.ofRadiance, 0.003);
    }
  }
}

// Light from below a floor's horizon is none of its; a lobe prefiltered without one has it.
TEST(SubtractiveCache, KnowsTheHorizon) {
  SceneMaker m;
  m.instance(m.mesh(tests::ground(400.0f), m.material(Vec3(0.9f), metalOf(0.5f))));
  m.camera(Vec3(0, 10, 30), Vec3(0, 5, 0), 0.3f);
  m.scene.cameras[0].perspective = false;
  m.scene.cameras[0].yheight = 4.0f;
  Stage s(m.finish(), 6, 6, 1);
  Sky sky{s, tests::mapOf(256, 128, [](int, int y) { return Vec3(y < 64 ? 0.1f : 10.0f); })};
  const TermPtr cached = sky.cached(), prefiltered = sky.prefiltered(DiffuseBy::Table);
  const double truth = double(sky.exact(0).specular.x);
  const double a = double(cached->floats("specular")[0]), b = double(prefiltered->floats("specular")[0]);
  std::printf("above a bright lower hemisphere: exact %.4f, cached %.4f, prefiltered %.4f\n", truth, a, b);
  EXPECT_LT(std::abs(a - truth), 0.15 * std::abs(b - truth));
}

// Each pixel of a wide view has another direction to the eye than the middle: the ball lies at 0.4 of the field of view off the axis.
TEST(SubtractiveCache, ErrsMoreTheWiderTheView) {
  double before = 0;
  for (const double degrees : {0.0, 10.0, 30.0, 60.0, 90.0}) {
    const double off = 0.4 * degrees * std::numbers::pi / 180;
    // The eye looks at the middle of the picture, which the ball is `off` away from.
    const Vec3 from(0, 0, 12), to = from + 10.0f * Vec3(float(std::sin(off)), 0, float(-std::cos(off)));
    Stage s(ball(metalOf(0.35f), from, to, 0.17f + float(degrees * std::numbers::pi / 180)), 360, 120, 1);
    Sky sky{s, waves(5)};
    // Some thirty places of the ball, or a hundred.
    const size_t all = degrees < 20 ? 97 : degrees < 50 ? 11 : 2;
    const size_t few = degrees < 5 ? 300 : degrees < 20 ? 97 : degrees < 50 ? 21 : degrees < 80 ? 5 : 3;
    const double specular = sky.error(sky.cached(64), testing::thoroughOr(all, few)).specular;
    std::printf("field of view %2.0f degrees: RMS error of specular light %.4f\n", degrees, specular);
    EXPECT_GT(specular, before) << degrees;
    before = specular;
  }
  EXPECT_GT(before, 0.05);
}

// Sixteen roughnesses stand for a textured one; the worst is between two.
TEST(SubtractiveCache, BetweenTwoRoughnessesLightIsInterpolated) {
  double worst = 0;
  for (const float roughness : {0.13f, 0.23f, 0.42f, 0.8f}) {
    Stage s(ball(metalOf(roughness), Vec3(1, 2, 4), Vec3(0), 0.5f, true), 24, 24, 1);
    Sky sky{s, waves(3)};
    RadianceCacheSettings c = sky.settings();
    ASSERT_EQ(c.roughness, std::vector<float>{roughness});
    c.side = testing::thoroughOr(64, 32);  // of both alike: what is compared is the roughness
    const TermPtr own = sky.cached(c);
    const float apart = (1.0f - 0.0316f) / 15;
    c.roughness = {roughness - 0.5f * apart, roughness + 0.5f * apart};
    const TermPtr between = sky.cached(c);
    double wrong = 0, all = 0;
    for (size_t i = 0; i < own->floats("specular").size(); ++i) {
      const double a = double(own->floats("specular")[i]), b = double(between->floats("specular")[i]);
      wrong += (a - b) * (a - b), all += a * a;
    }
    worst = std::max(worst, std::sqrt(wrong / all));
  }
  std::printf("half way between two of sixteen roughnesses: RMS error at most %.5f\n", worst);
  EXPECT_LT(worst, 0.01);
}

// Whatever lies in the tables, light is a number of 0 or more.
TEST(SubtractiveCache, TablesWithoutNumbersGiveNoLightAndHugeOnesABound) {
  Stage s(ball(plasticOf(0.4f)), 12, 12, 1);
  Sky sky{s, constantEnvironment(Vec3(1.0f)), 0.0f, Vec3(3.0f)};
  RadianceCacheSettings c = sky.settings();
  c.side = 4;
  for (const float value : {std::numeric_limits<float>::quiet_NaN(), -1.0f, 3e38f}) {
    auto tables = std::make_shared<Term>("radiance_cache", Domain::Table, Extent{1, 1, 1});
    for (const auto& [name, channels] : {std::pair("cosine", 3 * 16), std::pair("lobe0", 12 * 16)})
      for (float& v : tables->addPlane<float>(name, channels)) v = value;
    const TermPtr light = s.run(subtractive::makeCachedMapNode(s.view, c, 0.0f, sky.scale), {s.g, s.surface, tables});
    int lit = 0;
    for (const char* lobe : {"diffuse", "specular"})
      for (const float v : light->floats(lobe)) {
        ASSERT_TRUE(v >= 0.0f && v <= 1e30f) << value << " " << v;
        lit += v > 0.0f;
      }
    EXPECT_EQ(lit > 0, value > 0.0f) << value;
  }
}

TEST(SubtractiveCache, RoughnessesAreThoseOfTheScenesMaterials) {
  SceneMaker m;
  std::vector<float> expected;
  for (int k = 0; k < 16; ++k) {
    const float roughness = 0.9f - 0.05f * float(k);
    m.instance(m.mesh(tests::ground(1.0f, float(k)), m.material(Vec3(0.5f), metalOf(roughness))));
    expected.insert(expected.begin(), roughness);
  }
  m.material(Vec3(0.5f), metalOf(0.33f));                                  // nobody uses it
  m.instance(m.mesh(tests::ground(1.0f, -1.0f), m.material(Vec3(0.5f))));  // does not shine
  m.camera(Vec3(0, 1, 1), Vec3(0));
  EXPECT_EQ(subtractive::cachedRoughnesses(*m.finish()), expected);
  m.instance(m.mesh(tests::ground(1.0f, -2.0f), m.material(Vec3(0.5f), plasticOf(0.0f))));
  const std::vector<float> levels = subtractive::cachedRoughnesses(*m.finish());
  ASSERT_EQ(levels.size(), 16u);
  EXPECT_NEAR(levels.front() * levels.front(), kDeltaAlpha, 1e-6f);
  EXPECT_FALSE(levels.front() * levels.front() < kDeltaAlpha);
  EXPECT_EQ(levels.back(), 0.9f);
  for (size_t k = 1; k < 16; ++k) EXPECT_NEAR(levels[k] - levels[k - 1], (0.9f - levels[0]) / 15, 1e-6f);
}

TEST(SubtractiveCache, TexturedRoughnessHasAllLevels) {
  SceneMaker m;
  auto texture = std::make_shared<Texture>();
  texture->width = texture->height = 1;
  texture->texels8 = std::vector<uint8_t>{255, 128, 255, 255};
  sealTexture(*texture);
  m.scene.textures.push_back(texture);
  m.instance(m.mesh(tests::ground(1.0f), m.material(Vec3(0.5f), [](Material& x) {
    x.bsdf = {}, x.bsdf.roughness = 0.8f;
    x.bsdf.metallicRoughness.texture = 0;
  })));
  m.camera(Vec3(0, 1, 1), Vec3(0));
  const std::vector<float> levels = subtractive::cachedRoughnesses(*m.finish());
  ASSERT_EQ(levels.size(), 16u);
  EXPECT_NEAR(levels.front() * levels.front(), kDeltaAlpha, 1e-6f);
  EXPECT_EQ(levels.back(), 0.8f);
}

}  // namespace unshadowed_test
}  // namespace gobo::subtractive_test

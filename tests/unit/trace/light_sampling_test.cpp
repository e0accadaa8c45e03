// SPDX-License-Identifier: Apache-2.0
// Oracles: quadrature of the densities, closed-form irradiance, analytic limits, exhaustive search.
#include "trace/light_sampling.h"

#include <gtest/gtest.h>

#include <numbers>

#include "support/chi2.h"
#include "support/lit_scene.h"
#include "support/thorough.h"
#include "trace/alias_table.h"
#include "trace/area_lights.h"

namespace gobo {
namespace {

using namespace test;

/// Chi-squared of light 0 of a scene seen from p, in the cone of directions that `axis` and `span` give.
Chi2Result chi2OfAreaLight(const LightShape& shape, const Vec3& p, uint64_t seed, SphereDomain d = {}) {
  LitScene lit;
  lit.add(shape);
  const LightSampler& s = lit.build();
  return chi2Test(
      d, gobo::testing::thoroughOr(60000, 30000), seed,
      [&](Rng& rng, Vec3& w) {
        LightSample out;
        if (!s.sample(0, p, rng.next2(), out)) return false;
        w = out.direction;
        return true;
      },
      [&](const Vec3& w) {
        Ray ray{p, w};
        float t;
        Vec3 n;
        return s.intersectAreaLights(ray, t, n) == 0 ? double(s.pdf(0, p, w, t, 0)) : 0.0;
      },
      8);
}

struct AreaCase {
  const char* name;
  LightShape shape;
  Vec3 p;
  SphereDomain domain;
  double least;
};

std::vector<AreaCase> areaCases() {
  const LightShape square = rectLight(Vec3(0, 2, 0), Vec3(1, 0, 0), Vec3(0, 0, 1));  // cross(x, z) = -y: shines down
  const LightShape tilted = rectLight(Vec3(0.3f, 1, -0.2f), Vec3(0.8f, 0.6f, 0), Vec3(0, 0, 2));
  const auto cone = [](const Vec3& from, const LightShape& s, double radius) {
    const Vec3 d = s.position - from;
    const double sin2 = std::min(radius * radius / double(glm::dot(d, d)), 1.0);
    return SphereDomain{glm::normalize(d), 1.1 * sin2 / (1.0 + std::sqrt(1.0 - sin2)), 16, 24};
  };
  const Vec3 o(0.0f), far(300, -400, 200);
  const LightShape disk = diskLight(Vec3(0, 2, 0), Vec3(0.2f, -1, 0.1f), 0.9f), ball = sphereLight(Vec3(0, 2, 0), 0.7f);
  return {
      {"rect above", square, o, cone(o, square, 1.5), 0.999},
      {"rect aside", square, Vec3(3, 1, 1), cone(Vec3(3, 1, 1), square, 1.5), 0.999},
      {"rect near", square, Vec3(0.2f, 1.99f, -0.3f), {}, 0.99},
      {"rect tilted", tilted, Vec3(0.5f, -1, 1), cone(Vec3(0.5f, -1, 1), tilted, 2.3), 0.999},
      {"rect two-sided behind", rectLight(Vec3(0, 2, 0), Vec3(1, 0, 0), Vec3(0, 0, 1), true), Vec3(0.4f, 4, 0), cone(Vec3(0.4f, 4, 0), square, 1.5), 0.999},
      {"rect far (by area)", square, far, cone(far, square, 1.5), 0.99},
      {"disk far", disk, Vec3(0, -2, 0), cone(Vec3(0, -2, 0), disk, 0.95), 0.999},
      {"disk very far", disk, far, cone(far, disk, 0.95), 0.99},
      {"disk near", disk, o, cone(o, disk, 0.95), 0.7},
      {"disk close", disk, Vec3(0.3f, 1.9f, 0), {}, 0.7},
      {"sphere", ball, o, cone(o, ball, 0.7), 0.999},
      {"sphere close", ball, Vec3(0, 1.29f, 0), {}, 0.99},
      {"sphere far", ball, far, cone(far, ball, 0.7), 0.99},
      {"sphere tiny", sphereLight(Vec3(0, 2, 0), 1e-6f), o, cone(o, sphereLight(Vec3(0, 2, 0), 1e-6f), 1e-6), 0.0},
  };
}

TEST(AreaLights, ChiSquaredOfSamplesAgainstDensity) {
  const auto cases = areaCases();
  double lowest = 1, highest = 0;
  for (const AreaCase& c : cases) {
    if (std::string(c.name) == "sphere tiny") continue;  // float directions are coarser than its bins; see TinyAndFarLights
    const Chi2Result r = chi2OfAreaLight(c.shape, c.p, uint64_t(&c - cases.data()) + 1, c.domain);
    EXPECT_GT(r.p, sidak(int(cases.size()))) << c.name << " chi2 " << r.statistic << "/" << r.degrees << " integral " << r.integral << " refused " << r.refused;
    EXPECT_GT(r.integral, c.least) << c.name;
    EXPECT_LT(r.integral, 1.005) << c.name;
    lowest = std::min(lowest, r.p);
    highest = std::max(highest, r.p);
  }
  std::printf("  chi2 p-values of %zu area-light cases: %.4f .. %.4f\n", cases.size() - 1, lowest, highest);
}

/// sample, pdf, intersectAreaLights and emitted tell one story.
TEST(AreaLights, SamplesLieOnTheLightWithTheStatedDensity) {
  for (const AreaCase& c : areaCases()) {
    LitScene lit;
    lit.add(c.shape);
    const LightSampler& s = lit.build();
    Rng rng(2);
    int hits = 0, accepted = 0;
    for (int i = 0; i < 400; ++i) {
      LightSample out;
      if (!s.sample(0, c.p, rng.next2(), out)) continue;
      ++accepted;
      EXPECT_NEAR(glm::length(out.direction), 1.0f, 1e-5f);
      float t;
      Vec3 n;
      if (s.intersectAreaLights({c.p, out.direction}, t, n) != 0) continue;
      ++hits;
      EXPECT_NEAR(t, out.distance, 2e-3f * out.distance) << c.name;
      EXPECT_NEAR(s.pdf(0, c.p, out.direction, t, 0), out.pdf, 2e-3f * out.pdf) << c.name;
      EXPECT_EQ(s.emitted(0, out.direction, 0, 0, 0, n), out.radiance) << c.name;
    }
    EXPECT_GT(accepted, 250) << c.name;
    if (std::string(c.name) == "sphere tiny") continue;
    EXPECT_GT(hits, accepted * 97 / 100) << c.name;  // edges round to either side
  }
}

/// Irradiance from a parallel rectangle with a corner above the point: half the form factor of Hottel's tables.
double cornerIrradiance(double a, double b, double h) {
  const double x = a / h, y = b / h, p = std::sqrt(1 + x * x), q = std::sqrt(1 + y * y);
  return 0.5 * (x / p * std::atan(y / p) + y / q * std::atan(x / q));
}

TEST(AreaLights, RectangleMatchesTheFormFactor) {
  for (double h : {0.1, 1.0, 3.0, 30.0}) {
    LitScene lit;
    lit.add(rectLight(Vec3(0, float(h), 0), Vec3(0.75f, 0, 0), Vec3(0, 0, 0.5f)));
    const double truth = 4 * cornerIrradiance(0.75, 0.5, h);
    EXPECT_NEAR(irradiance(lit.build(), 0, Vec3(0), Vec3(0, 1, 0)).mean, truth, 2e-3 * truth) << h;
  }
}

TEST(AreaLights, DiskMatchesTheClosedForm) {
  for (double h : {0.02, 0.5, 2.5, 3.5, 40.0}) {
    LitScene lit;
    lit.add(diskLight(Vec3(0, float(h), 0), Vec3(0, -1, 0), 1.0f));
    const double truth = std::numbers::pi / (1 + h * h);
    EXPECT_NEAR(irradiance(lit.build(), 0, Vec3(0), Vec3(0, 1, 0)).mean, truth, 1e-2 * truth) << h;
  }
}

TEST(AreaLights, SphereMatchesTheClosedForm) {
  for (double d : {1.2, 2.0, 10.0, 1000.0}) {
    LitScene lit;
    lit.add(sphereLight(Vec3(float(d * 0.6), float(d * 0.8), 0), 0.5f));
    const double truth = std::numbers::pi * 0.25 / (d * d) * 0.8;
    const Irradiance e = irradiance(lit.build(), 0, Vec3(0), Vec3(0, 1, 0));
    EXPECT_NEAR(e.mean, truth, 1e-3 * truth) << d;
  }
}

TEST(AreaLights, TinyAndFarLights) {
  for (double d : {1.0, 1e3, 1e5}) {
    LitScene lit;
    lit.add(sphereLight(Vec3(0, float(d), 0), 1e-6f));
    lit.add(rectLight(Vec3(0, float(d), 0), Vec3(1e-3f, 0, 0), Vec3(0, 0, 2e-3f)));
    lit.add(diskLight(Vec3(0, float(d), 0), Vec3(0, -1, 0), 1e-3f));
    const LightSampler& s = lit.build();
    const double areas[] = {std::numbers::pi * 1e-12, 8e-6, std::numbers::pi * 1e-6};
    for (int i = 0; i < 3; ++i) {
      const Irradiance e = irradiance(s, i, Vec3(0), Vec3(0, 1, 0), 256);
      EXPECT_NEAR(e.mean * d * d / areas[i], 1.0, 1e-4) << i << " at " << d;
      EXPECT_LT(e.deviation, 1e-3 * e.mean);
    }
  }
  // Just above and below the switch from solid angle to area.
  for (double sr : {0.9e-5, 1.1e-5}) {
    const double d = std::sqrt(4.0 / sr);
    LitScene lit;
    lit.add(rectLight(Vec3(0, float(d), 0), Vec3(1, 0, 0), Vec3(0, 0, 1)));
    EXPECT_NEAR(irradiance(lit.build(), 0, Vec3(0), Vec3(0, 1, 0), 256).mean / sr, 1.0, 1e-4);
  }
}

TEST(AreaLights, ReceiverAtAMicrometre) {
  const Vec3 up(0, 1, 0);
  LitScene lit;
  lit.add(rectLight(Vec3(0), Vec3(1, 0, 0), Vec3(0, 0, 1)));
  lit.add(diskLight(Vec3(0), Vec3(0, -1, 0), 1.0f));
  lit.add(sphereLight(Vec3(0, 1e-6f + 1e-3f, 0), 1e-3f));
  const LightSampler& s = lit.build();
  const Vec3 p(0, -1e-6f, 0);
  EXPECT_NEAR(irradiance(s, 0, p, up).mean, std::numbers::pi, 0.01);
  EXPECT_NEAR(irradiance(s, 1, p, up).mean, std::numbers::pi, 0.03);
  const double d = 1e-3 + 2e-6;
  EXPECT_NEAR(irradiance(s, 2, p, up).mean, std::numbers::pi * 1e-6 / (d * d), 0.01);
  // In the plane, behind it, on the surface, inside: no light and no NaN.
  LightSample out;
  for (const Vec3& q : {Vec3(0), Vec3(0.5f, 0, 0), Vec3(2, 0, 0), Vec3(0, 1, 0)})
    for (int i : {0, 1}) {
      EXPECT_FALSE(s.sample(i, q, Vec2(0.3f, 0.4f), out)) << i;
      EXPECT_EQ(s.pdf(i, q, up, 1.0f, 0), 0.0f);
    }
  for (const Vec3& q : {Vec3(0, 1e-3f, 0), Vec3(0, 1.2e-3f, 0)}) {
    EXPECT_FALSE(s.sample(2, q, Vec2(0.3f, 0.4f), out));
    EXPECT_EQ(s.pdf(2, q, up, 1.0f, 0), 0.0f);
  }
}

TEST(AreaLights, SolidAngleOfACubeFace) {
  // From a cube's centre each face fills a sixth of the sphere, from a corner's opposite face a 24th... of 8 octants.
  EXPECT_NEAR(rectSolidAngle(rectLight(Vec3(0, 1, 0), Vec3(1, 0, 0), Vec3(0, 0, 1)), Vec3(0)), 4 * std::numbers::pi / 6, 1e-12);
  EXPECT_NEAR(rectSolidAngle(rectLight(Vec3(1, 2, 1), Vec3(1, 0, 0), Vec3(0, 0, 1)), Vec3(0)), 4 * std::numbers::pi / 24, 1e-12);
}

TEST(AreaLights, AThousandLightsAreFoundAsByExhaustiveSearch) {
  LitScene lit;
  Rng rng(9);
  const auto point = [&](float scale) {
    const float x = rng.next(), y = rng.next();
    return (Vec3(x, y, rng.next()) - 0.5f) * scale;
  };
  for (int i = 0; i < 1000; ++i) {
    const Vec3 at = point(20.0f), axis = glm::normalize(point(1.0f));
    const Frame f(axis);
    if (i % 3 == 0) lit.add(sphereLight(at, 0.2f), i % 2 == 0);
    if (i % 3 == 1) lit.add(diskLight(at, axis, 0.4f), i % 2 == 0);
    if (i % 3 == 2) lit.add(rectLight(at, f.x * 0.3f, f.y * 0.5f, i % 4 == 0), i % 2 == 0);
  }
  const LightSampler& s = lit.build();
  int found = 0;
  for (int k = 0; k < 3000; ++k) {
    Ray ray{point(24.0f), glm::normalize(point(1.0f))};
    if (k % 7 == 0) ray.direction = Vec3(0, k % 2 ? 1 : -1, 0);  // divisions by zero in the box test
    if (k % 5 == 0) ray.tmax = 5.0f;
    for (bool visible : {false, true}) {
      int best = -1;
      float nearest = ray.tmax, t, t2;
      Vec3 n, n2, bestN;
      for (int i = 0; i < 1000; ++i) {
        if (visible && !lit.scene->lights[i].cameraVisible) continue;
        if (intersectAreaLight(lit.scene->lights[i].shape, ray, t, n) && t < nearest) {
          nearest = t;
          best = i;
          bestN = n;
        }
      }
      const int hit = s.intersectAreaLights(ray, t2, n2, visible);
      ASSERT_EQ(hit, best);
      if (best < 0) continue;
      ++found;
      EXPECT_EQ(t2, nearest);
      EXPECT_EQ(n2, bestN);
    }
  }
  EXPECT_GT(found, 300);
}

TEST(AreaLights, ARayMeetsEveryLightOnce) {
  LitScene lit;
  for (int i = 0; i < 5; ++i) lit.add(sphereLight(Vec3(0, 1.0f + float(i) * 0.37f, 0), 0.1f));
  lit.add(rectLight(Vec3(0, 5, 0), Vec3(1, 0, 0), Vec3(0, 0, 1)));
  lit.add(rectLight(Vec3(0, 4, 0), Vec3(1, 0, 0), Vec3(0, 0, -1)));  // its back: passed
  const LightSampler& s = lit.build();
  Ray ray{Vec3(0.01f, 0, 0), Vec3(0, 1, 0)};
  std::vector<int> met;
  float t;
  Vec3 n;
  for (int k = 0; k < 20; ++k) {
    const int i = s.intersectAreaLights(ray, t, n);
    if (i < 0) break;
    met.push_back(i);
    ray.tmin = t;
  }
  EXPECT_EQ(met, (std::vector<int>{0, 1, 2, 3, 4, 5}));
}

TEST(AreaLights, CoincidentLightsTieToTheLowerIndex) {
  LitScene lit;
  for (int i = 0; i < 8; ++i) lit.add(rectLight(Vec3(0, 1, 0), Vec3(1, 0, 0), Vec3(0, 0, 1)));
  float t;
  Vec3 n;
  EXPECT_EQ(lit.build().intersectAreaLights({Vec3(0), Vec3(0, 1, 0)}, t, n), 0);
}

TEST(PunctualLights, FollowTheInverseSquareAndTheWindow) {
  LitScene lit;
  LightShape s;
  s.position = Vec3(0, 2, 0);
  lit.add(s);
  s.range = 4.0f;
  lit.add(s);
  const LightSampler& sampler = lit.build();
  LightSample out;
  ASSERT_TRUE(sampler.sample(0, Vec3(0, -1, 0), Vec2(0), out));
  EXPECT_TRUE(out.delta);
  EXPECT_EQ(out.pdf, 1.0f);
  EXPECT_FLOAT_EQ(out.radiance.x, 1.0f / 9.0f);
  EXPECT_FLOAT_EQ(out.distance, 3.0f);
  EXPECT_EQ(out.direction, Vec3(0, 1, 0));
  ASSERT_TRUE(sampler.sample(1, Vec3(0, -1, 0), Vec2(0), out));
  EXPECT_FLOAT_EQ(out.radiance.x, (1.0f - 81.0f / 256.0f) / 9.0f);
  EXPECT_FALSE(sampler.sample(1, Vec3(0, -2.0f, 0), Vec2(0), out));
  EXPECT_EQ(sampler.pdf(0, Vec3(0), Vec3(0, 1, 0), 2.0f, 0), 0.0f);
}

TEST(PunctualLights, StayFiniteOnTheLamp) {
  LitScene lit;
  lit.add({});  // point at the origin
  const LightSampler& sampler = lit.build();
  LightSample out;
  EXPECT_FALSE(sampler.sample(0, Vec3(0), Vec2(0), out));
  for (float d : {1e-6f, 1e-9f, 1e-18f, 1e-22f, 1e-30f}) {
    if (!sampler.sample(0, Vec3(0, -d, 0), Vec2(0), out)) continue;
    EXPECT_TRUE(std::isfinite(out.radiance.x * 1e6f)) << d;  // with an intensity of 1e6
    EXPECT_LE(out.radiance.x, 1.0001e12f);
    EXPECT_EQ(out.direction, Vec3(0, 1, 0));
  }
  ASSERT_TRUE(sampler.sample(0, Vec3(0, -1e-6f, 0), Vec2(0), out));
  EXPECT_NEAR(out.radiance.x, 1e12f, 1e7f);
}

TEST(PunctualLights, SpotConeIsTheSquaredRamp) {
  LitScene lit;
  LightShape s;
  s.kind = LightKind::Spot;
  s.axis = Vec3(0, -1, 0);
  s.cosInner = 0.9f;
  s.cosOuter = 0.7f;
  lit.add(s);
  s.cosInner = s.cosOuter;  // hard edge
  lit.add(s);
  const LightSampler& sampler = lit.build();
  const auto at = [&](int i, double cosine) {
    LightSample out;
    const Vec3 p = Vec3(float(std::sqrt(1 - cosine * cosine)), float(-cosine), 0);
    return sampler.sample(i, p, Vec2(0), out) ? out.radiance.x : 0.0f;
  };
  EXPECT_NEAR(at(0, 0.95), 1.0f, 1e-5f);
  EXPECT_NEAR(at(0, 0.8), 0.25f, 1e-5f);
  EXPECT_EQ(at(0, 0.69), 0.0f);
  EXPECT_EQ(at(0, -1.0), 0.0f);
  EXPECT_NEAR(at(1, 0.71), 1.0f, 1e-4f);
  EXPECT_NEAR(at(1, 0.7005), 0.25f, 0.01f);  // the extension's ramp of at least a thousandth
  EXPECT_EQ(at(1, 0.699), 0.0f);
}

TEST(PunctualLights, DirectionalIsIrradianceAlongItsAxis) {
  LitScene lit;
  LightShape s;
  s.kind = LightKind::Directional;
  s.axis = glm::normalize(Vec3(1, -2, 0));
  lit.add(s);
  LightSample out;
  ASSERT_TRUE(lit.build().sample(0, Vec3(5), Vec2(0.5f), out));
  EXPECT_EQ(out.direction, -s.axis);
  EXPECT_EQ(out.radiance, Vec3(1));
  EXPECT_TRUE(out.delta);
  EXPECT_GE(out.distance, 3e38f);
}

TEST(AliasTable, DrawsInProportionAndKeepsTheRestUniform) {
  const std::vector<double> weights = {1, 0, 5, 1e-12, 3, 0, 0.5};
  const AliasTable table(weights);
  const int n = 1 << 20;
  std::vector<int> count(weights.size(), 0);
  std::vector<double> rest(weights.size(), 0.0);
  for (int i = 0; i < n; ++i) {
    float u = (float(i) + 0.5f) / n;
    const uint32_t k = table.sample(u);
    ASSERT_GE(u, 0.0f);
    ASSERT_LT(u, 1.0f);
    ++count[k];
    rest[k] += u;
  }
  for (size_t k = 0; k < weights.size(); ++k) {
    EXPECT_NEAR(count[k] / double(n), weights[k] / 9.5, 1e-5) << k;
    if (weights[k] == 0) {
      EXPECT_EQ(count[k], 0);
    } else if (count[k] > 1000) {
      EXPECT_NEAR(rest[k] / count[k], 0.5, 1e-3) << k;
    }
  }
  EXPECT_TRUE(AliasTable(std::vector<double>{0, 0}).empty());
  for (size_t size : {1u, 7u, 1000u}) {  // equal weights: rounding leaves partnerless items
    const AliasTable equal(std::vector<double>(size, 0.1));
    float u = 0x1.fffffep-1f;
    EXPECT_LT(equal.sample(u), size);
  }
}

}  // namespace
}  // namespace gobo

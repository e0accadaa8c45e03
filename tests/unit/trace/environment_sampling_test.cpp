// SPDX-License-Identifier: Apache-2.0
// Oracles: quadrature, closed-form irradiance of a single texel, exact solid angles in extended precision.
#include <gtest/gtest.h>

#include "support/chi2.h"
#include "support/lit_scene.h"
#include "trace/environment_distribution.h"

namespace gobo {
namespace {

using namespace test;

constexpr double kDPi = 3.14159265358979323846;

std::shared_ptr<Environment> makeMap(int w, int h, float rotation, const std::function<Vec3(int, int)>& texel) {
  Image image(w, h, 3);
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
      for (int c = 0; c < 3; ++c) image.data[(size_t(y) * w + x) * 3 + c] = texel(x, y)[c];
  auto map = std::make_shared<Environment>(*makeEnvironment("test", std::move(image)));
  map->rotation = rotation;
  return map;
}

LitScene lit(std::shared_ptr<Environment> map) {
  LitScene s;
  s.scene->environment = map;
  s.add(environmentLight());
  s.build();
  return s;
}

Chi2Result chi2Of(const LitScene& s, uint64_t seed, SphereDomain d) {
  return chi2Test(d, 60000, seed,
                  [&](Rng& rng, Vec3& w) {
                    LightSample out;
                    if (!s.sampler->sample(0, Vec3(0), rng.next2(), out)) return false;
                    w = out.direction;
                    return true;
                  },
                  [&](const Vec3& w) { return double(s.sampler->pdf(0, Vec3(0), w, 3e38f, 0)); }, 7);
}

TEST(EnvironmentSampling, ChiSquaredOfSamplesAgainstDensity) {
  const auto checker = [](int x, int y) { return (x + y) & 1 ? Vec3(1e6f, 1, 1) : Vec3(1, 0.5f, 0.1f); };
  const auto ramp = [](int x, int y) { return Vec3(float(x * x + 1), float(y), 0); };
  const auto colours = [](int x, int y) { return x == 3 ? Vec3(0) : x % 2 ? Vec3(0, 0, 5) : Vec3(1, 0, 0); };
  const SphereDomain sphere{Vec3(0, 1, 0), 2.0, 16, 24};
  const LitScene maps[] = {lit(makeMap(1, 1, 0, [](int, int) { return Vec3(2); })), lit(makeMap(8, 4, 0, checker)),
                           lit(makeMap(12, 6, 1.234f, ramp)),                       lit(makeMap(5, 3, -7.0f, colours)),
                           lit(makeMap(1, 9, 0, ramp)),                             lit(makeMap(9, 1, 2.0f, ramp))};
  double lowest = 1, highest = 0;
  uint64_t seed = 40;
  for (const LitScene& m : maps) {
    const Chi2Result r = chi2Of(m, seed++, sphere);
    EXPECT_GT(r.p, sidak(6)) << "map " << seed - 40 << " chi2 " << r.statistic << "/" << r.degrees << " integral " << r.integral;
    EXPECT_NEAR(r.integral, 1.0, 2e-3);
    EXPECT_EQ(r.refused, 0);
    lowest = std::min(lowest, r.p);
    highest = std::max(highest, r.p);
  }
  std::printf("  chi2 p-values of 6 environments: %.4f .. %.4f\n", lowest, highest);
}

/// The sampler's uv algebra is its own: directions must fall into the texel whose radiance is stated.
TEST(EnvironmentSampling, SamplesMatchLookUpAndDensity) {
  Rng rng(5);
  for (float rotation : {0.0f, 0.5f, 3.0f, -100.0f}) {
    const LitScene s = lit(makeMap(64, 32, rotation, [](int x, int y) { return Vec3(float(1 + (x * 7 + y * 13) % 31), 1, float(y)); }));
    int same = 0;
    const int n = 2000;
    for (int i = 0; i < n; ++i) {
      LightSample out;
      ASSERT_TRUE(s.sampler->sample(0, Vec3(3), rng.next2(), out));
      EXPECT_GE(out.distance, 3e38f);
      EXPECT_NEAR(glm::length(out.direction), 1.0f, 1e-6f);
      if (s.scene->environment->eval(out.direction) != out.radiance) continue;  // rounded over a texel's edge
      ++same;
      EXPECT_EQ(s.sampler->pdf(0, Vec3(3), out.direction, 3e38f, 0), out.pdf);
      EXPECT_EQ(s.sampler->emitted(0, out.direction, 0, 0, 0, Vec3(0)), out.radiance);
    }
    EXPECT_GT(same, n - 10);
  }
}

/// One texel a million times as bright as the rest: irradiance in closed form, and hardly any variance.
TEST(EnvironmentSampling, OneHotTexelIntegratesExactly) {
  const int w = 64, h = 32;
  for (int row : {0, 4, 11}) {
    for (float rotation : {0.0f, 1.0f}) {
      const LitScene s = lit(makeMap(w, h, rotation, [&](int x, int y) { return x == 17 && y == row ? Vec3(1e6f) : Vec3(1); }));
      const double t0 = kDPi * row / h, t1 = kDPi * (row + 1) / h;
      const double hot = (2 * kDPi / w) * 0.5 * (std::pow(std::sin(t1), 2) - std::pow(std::sin(t0), 2));
      const double truth = kDPi + (1e6 - 1) * hot;
      const Irradiance e = irradiance(*s.sampler, 0, Vec3(0), Vec3(0, 1, 0));
      EXPECT_NEAR(e.mean / truth, 1.0, 1e-3) << "row " << row;
      EXPECT_LT(e.deviation, 0.15 * e.mean);
    }
  }
}

TEST(EnvironmentSampling, UniformSphereGivesPi) {
  const LitScene s = lit(makeMap(1, 1, 0, [](int, int) { return Vec3(1); }));
  const Vec3 n = glm::normalize(Vec3(1, -2, 0.5f));
  EXPECT_NEAR(irradiance(*s.sampler, 0, Vec3(0), n, 16384).mean, kDPi, 2e-3);
  for (const Vec3& d : {Vec3(0, 1, 0), Vec3(0, -1, 0), Vec3(1, 0, 0), Vec3(-1, 0, 0), Vec3(-1, 0, -0.0f)})
    EXPECT_NEAR(s.sampler->pdf(0, Vec3(0), d, 3e38f, 0), 1 / (4 * kDPi), 1e-8);
}

TEST(EnvironmentSampling, BlackMapsAndMissingMapsGiveNothing) {
  const LitScene s = lit(makeMap(4, 2, 0, [](int, int) { return Vec3(0); }));
  LightSample out;
  EXPECT_FALSE(s.sampler->sample(0, Vec3(0), Vec2(0.5f), out));
  EXPECT_EQ(s.sampler->pdf(0, Vec3(0), Vec3(0, 1, 0), 3e38f, 0), 0.0f);
  EXPECT_EQ(s.sampler->emitted(0, Vec3(0, 1, 0), 0, 0, 0, Vec3(0)), Vec3(0));
  const EnvironmentDistribution none(nullptr);
  Vec3 w, l;
  float pdf;
  EXPECT_FALSE(none.sample(Vec2(0.5f), w, l, pdf));
  EXPECT_EQ(none.pdf(Vec3(0, 1, 0)), 0.0f);
}

/// Zero texels are never drawn, at the ends of the unit square neither.
TEST(EnvironmentSampling, EndsOfTheSquareFindLitTexels) {
  const float last = 0x1.fffffep-1f;
  for (int lit1 = 0; lit1 < 12; ++lit1) {
    const auto map = makeMap(4, 3, 0, [&](int x, int y) { return y * 4 + x == lit1 ? Vec3(1e-30f) : Vec3(0); });
    const EnvironmentDistribution d(map);
    for (const Vec2& u : {Vec2(0), Vec2(last), Vec2(0, last), Vec2(last, 0), Vec2(0.5f)}) {
      Vec3 w, l;
      float pdf;
      ASSERT_TRUE(d.sample(u, w, l, pdf));
      EXPECT_EQ(l, Vec3(1e-30f));
      EXPECT_TRUE(isFinite(w));
      EXPECT_NEAR(pdf * d.texelSolidAngle(lit1 / 4), 1.0, 1e-5);
    }
  }
}

TEST(EnvironmentSampling, TexelSolidAnglesAreExactAtThePoles) {
  const int w = 4, h = 8192;
  auto map = std::make_shared<Environment>();
  map->width = w;
  map->height = h;
  map->texels.resize(size_t(w) * h);  // black
  const EnvironmentDistribution d(map);
  double sum = 0;
  for (int y = 0; y < h; ++y) {
    const long double s0 = sinl(3.14159265358979323846264L * y / (2.0L * h)), s1 = sinl(3.14159265358979323846264L * (y + 1) / (2.0L * h));
    const double exact = double(2.0L * 3.14159265358979323846264L / w * 2.0L * (s1 - s0) * (s1 + s0));  // cos = 1 - 2 sin^2 of the half
    EXPECT_NEAR(d.texelSolidAngle(y) / exact, 1.0, 1e-12) << y;
    sum += d.texelSolidAngle(y) * w;
  }
  EXPECT_NEAR(sum, 4 * kDPi, 1e-10);
}

/// A million dim texels beside one bright one: a float prefix sum would swallow them.
TEST(EnvironmentSampling, DimTexelsKeepTheirShare) {
  const int w = 2048, h = 1024;
  const auto map = makeMap(w, h, 0, [](int x, int y) { return x == 0 && y == 512 ? Vec3(1e6f) : Vec3(0.1f); });
  const EnvironmentDistribution d(map);
  double truth = 0;
  for (int y = 0; y < h; ++y) truth += d.texelSolidAngle(y) * w * 0.1;
  truth += d.texelSolidAngle(512) * (1e6 - 0.1);
  EXPECT_NEAR(d.total() / truth, 1.0, 1e-6);
  Rng rng(8);
  int dim = 0;
  const int n = 20000;
  const double share = 1.0 - d.texelSolidAngle(512) * 1e6 / truth;
  for (int i = 0; i < n; ++i) {
    Vec3 dir, l;
    float pdf;
    ASSERT_TRUE(d.sample(rng.next2(), dir, l, pdf));
    dim += l.x < 1.0f;
  }
  EXPECT_NEAR(dim / double(n), share, 4.5 * std::sqrt(share * (1 - share) / n));
}

}  // namespace
}  // namespace gobo

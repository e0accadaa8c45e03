// SPDX-License-Identifier: Apache-2.0
// Oracles: quadrature of the look-up, bounds on radiance over density, sums over the sphere in extended precision.
#include <gtest/gtest.h>

#include <numbers>

#include "support/chi2.h"
#include "support/lit_scene.h"
#include "trace/environment_distribution.h"

namespace gobo {
namespace {

using namespace test;

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
  return chi2Test(
      d, 60000, seed,
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
  const LitScene maps[] = {lit(makeMap(1, 1, 0, [](int, int) { return Vec3(2); })),
                           lit(makeMap(8, 4, 0, checker)),
                           lit(makeMap(12, 6, 1.234f, ramp)),
                           lit(makeMap(5, 3, -7.0f, colours)),
                           lit(makeMap(1, 9, 0, ramp)),
                           lit(makeMap(9, 1, 2.0f, ramp))};
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

/// The sampler's algebra is its own: what it states must be what the look-up says of the direction that it gives.
TEST(EnvironmentSampling, SamplesMatchLookUpAndDensity) {
  Rng rng(5);
  for (float rotation : {0.0f, 0.5f, 3.0f, -100.0f}) {
    const LitScene s = lit(makeMap(64, 32, rotation, [](int x, int y) { return Vec3(float(1 + (x * 7 + y * 13) % 31), 1, float(y)); }));
    for (int i = 0; i < 2000; ++i) {
      LightSample out;
      ASSERT_TRUE(s.sampler->sample(0, Vec3(3), rng.next2(), out));
      EXPECT_GE(out.distance, 3e38f);
      EXPECT_NEAR(glm::length(out.direction), 1.0f, 1e-6f);
      const Vec3 seen = s.sampler->emitted(0, out.direction, 0, 0, 0, Vec3(0));
      EXPECT_EQ(seen, s.scene->environment->eval(out.direction));
      for (int c = 0; c < 3; ++c)
        EXPECT_NEAR(out.radiance[c], seen[c], 1e-3f * (1 + seen[c]));  // rounding of the direction moves it by 1e-5 texels; steps are up to 30
      EXPECT_NEAR(s.sampler->pdf(0, Vec3(3), out.direction, 3e38f, 0) / out.pdf, 1.0f, 1e-3f);
    }
  }
}

/// Radiance over density is total / luminance's share of a channel, wherever a sample falls: no contrast of the map makes a sample weigh
/// more. Here it is the same number for every sample, so the estimate of the sphere's integral has no variance at all.
TEST(EnvironmentSampling, RadianceOverDensityIsBoundedAtAnyContrast) {
  for (const float hot : {1.0f, 1e3f, 1e6f, 1e12f})
    for (const int row : {0, 1, 7, 15, 30, 31}) {
      const auto map = makeMap(64, 32, 0.3f, [&](int x, int y) { return x == 63 && y == row ? Vec3(hot) : Vec3(1); });
      const EnvironmentDistribution d(map);
      Rng rng{uint64_t(row)};
      double least = 1e300, most = 0;
      for (int i = 0; i < 2000; ++i) {
        Vec3 w, l;
        float pdf;
        ASSERT_TRUE(d.sample(rng.next2(), w, l, pdf));
        least = std::min(least, double(l.y) / pdf);
        most = std::max(most, double(l.y) / pdf);
      }
      EXPECT_NEAR(least / d.total(), 1.0, 1e-5) << hot << " row " << row;
      EXPECT_NEAR(most / d.total(), 1.0, 1e-5) << hot << " row " << row;
    }
}

/// The importance of the map as a whole is the integral of the look-up.
TEST(EnvironmentSampling, TotalIsTheIntegralOfTheLookUp) {
  for (const auto& [w, h] : {std::pair{1, 1}, std::pair{1, 4}, std::pair{5, 1}, std::pair{4, 2}, std::pair{7, 3}, std::pair{16, 8}, std::pair{33, 17}}) {
    Rng rng{uint64_t(w * 100 + h)};
    std::vector<Vec3> texels;
    for (int i = 0; i < w * h; ++i) texels.push_back(Vec3(rng.next(), rng.next(), 20 * rng.next()));
    const auto map = makeMap(w, h, 0.7f, [&](int x, int y) { return texels[size_t(y) * w + x]; });
    // 24 x 24 midpoints a texel, by solid angle: the error is that of a linear function in bands of a 24th texel.
    const int nx = 24 * w, ny = 24 * h;
    double sum = 0;
    for (int y = 0; y < ny; ++y) {
      const double band = (std::cos(std::numbers::pi * y / ny) - std::cos(std::numbers::pi * (y + 1) / ny)) * 2 * std::numbers::pi / nx;
      for (int x = 0; x < nx; ++x) sum += band * luminance(map->eval(map->toDirection(Vec2((x + 0.5f) / nx, (y + 0.5f) / ny))));
    }
    EXPECT_NEAR(EnvironmentDistribution(map).total() / sum, 1.0, 1e-3) << w << " x " << h;
    EXPECT_NEAR(EnvironmentDistribution(map).total(), environmentFlux(map.get()), 1e-9 * sum);
  }
}

/// One texel a million times as bright as the rest: irradiance by quadrature of its tent, and hardly any variance.
TEST(EnvironmentSampling, OneHotTexelIntegratesExactly) {
  const int w = 64, h = 32, n = 4000;
  for (int row : {0, 4, 11}) {
    for (float rotation : {0.0f, 1.0f}) {
      const LitScene s = lit(makeMap(w, h, rotation, [&](int x, int y) { return x == 17 && y == row ? Vec3(1e6f) : Vec3(1); }));
      double hot = 0;  // the azimuthal tent integrates to one texel's width
      for (int k = 0; k < n; ++k) {
        const double at = -1 + (k + 0.5) * 2 / n, theta = std::numbers::pi * (row + 0.5 + at) / h;
        if (theta < 0) continue;
        hot +=
            (row == 0 && at < 0 ? 1 : 1 - std::fabs(at)) * std::sin(theta) * std::cos(theta) * (2.0 / n) * (std::numbers::pi / h) * (2 * std::numbers::pi / w);
      }
      const double truth = std::numbers::pi + (1e6 - 1) * hot;
      const Irradiance e = irradiance(*s.sampler, 0, Vec3(0), Vec3(0, 1, 0));
      EXPECT_NEAR(e.mean / truth, 1.0, 1e-3) << "row " << row;
      EXPECT_LT(e.deviation, 0.15 * e.mean);
    }
  }
}

TEST(EnvironmentSampling, UniformSphereGivesPi) {
  const LitScene s = lit(makeMap(1, 1, 0, [](int, int) { return Vec3(1); }));
  const Vec3 n = glm::normalize(Vec3(1, -2, 0.5f));
  EXPECT_NEAR(irradiance(*s.sampler, 0, Vec3(0), n, 16384).mean, std::numbers::pi, 2e-3);
  for (const Vec3& d : {Vec3(0, 1, 0), Vec3(0, -1, 0), Vec3(1, 0, 0), Vec3(-1, 0, 0), Vec3(-1, 0, -0.0f)})
    EXPECT_NEAR(s.sampler->pdf(0, Vec3(0), d, 3e38f, 0), 1 / (4 * std::numbers::pi), 1e-8);
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

/// Texels of 0 are never drawn, at the ends of the unit square neither: what is found lies under the lit texel's tent.
TEST(EnvironmentSampling, EndsOfTheSquareFindLitTexels) {
  const float last = 0x1.fffffep-1f, first = 0x1p-24f;
  for (int lit1 = 0; lit1 < 12; ++lit1) {
    const auto map = makeMap(4, 3, 0, [&](int x, int y) { return y * 4 + x == lit1 ? Vec3(1e-20f) : Vec3(0); });
    const EnvironmentDistribution d(map);
    for (const Vec2& u : {Vec2(first), Vec2(last), Vec2(first, last), Vec2(last, first), Vec2(0.5f)}) {
      Vec3 w, l;
      float pdf;
      ASSERT_TRUE(d.sample(u, w, l, pdf));
      EXPECT_TRUE(isFinite(w));
      EXPECT_GT(l.x, 0.0f);
      EXPECT_LE(l.x, 1e-20f);
      EXPECT_NEAR(double(pdf) * d.texelWeight(lit1 / 4) / (l.x * 1e20), 1.0, 1e-5);
      EXPECT_NEAR(map->eval(w).x, l.x, 1e-5f * 1e-20f);
    }
  }
}

TEST(EnvironmentSampling, TexelWeightsAreExactAtThePoles) {
  const int w = 4, h = 8192;
  auto map = std::make_shared<Environment>();
  map->width = w;
  map->height = h;
  map->texels.resize(size_t(w) * h);  // black
  const EnvironmentDistribution d(map);
  const long double pi = 3.14159265358979323846264L, step = pi / h;
  double sum = 0;
  for (int y = 0; y < h; ++y) {
    // Tents of a regular grid against the sine: by parts, sin(centre) (2 sin(step / 2) / step)^2; at a pole half of that and the cap.
    const long double centre = (y + 0.5L) * step, c = 2 * sinl(step / 2) / step, half = 2 * sinl(step / 4) * sinl(step / 4);
    const long double inner = sinl(step / 2) * c * c / 2 * step + cosl(step / 2) * (step - sinl(step)) / step;  // centre step / 2, the side away from the pole
    const long double exact = (y == 0 || y == h - 1 ? half + inner : sinl(centre) * c * c * step) * 2 * pi / w;
    EXPECT_NEAR(d.texelWeight(y) / double(exact), 1.0, 1e-9) << y;
    sum += d.texelWeight(y) * w;
  }
  EXPECT_NEAR(sum, 4 * std::numbers::pi, 1e-9);
}

/// The inverse of each row's distribution, against the forward integral by quadrature.
TEST(EnvironmentSampling, PolarAnglesFollowTheTent) {
  for (const int h : {1, 2, 3, 5, 25, 26, 64}) {  // rows of 25 are wider than the series is for
    const EnvironmentTents tents(1, h);
    for (int y = 0; y < h; y += std::max(1, h / 7)) {
      const double step = std::numbers::pi / h, from = y == 0 ? 0 : (y - 0.5) * step, to = y == h - 1 ? std::numbers::pi : (y + 1.5) * step;
      const int n = 20000;
      double sum = 0;
      const double all = tents.weight(y) / (2 * std::numbers::pi);
      double next = 0.05;
      for (int k = 0; k < n && next < 1; ++k) {
        const double theta = from + (k + 0.5) * (to - from) / n, at = theta / step - (y + 0.5);
        const double tent = (y == 0 && at < 0) || (y == h - 1 && at > 0) ? 1 : 1 - std::fabs(at);
        sum += tent * std::sin(theta) * (to - from) / n / all;
        for (; next < 1 && sum >= next; next += 0.05) {
          const EnvironmentTents::Polar polar = tents.polar(y, next);
          EXPECT_NEAR(polar.angle, theta, 1.5 * (to - from) / n) << h << " row " << y << " u " << next;
          EXPECT_NEAR(polar.sine, std::sin(polar.angle), 1e-15) << h << " row " << y << " u " << next;
          EXPECT_NEAR(polar.cosine, std::cos(polar.angle), 1e-15) << h << " row " << y << " u " << next;
        }
      }
      EXPECT_GT(next, 0.94);
    }
  }
}

/// u = cdf(polar(u)), where the distribution function of a tent that touches no pole is closed: (F(theta) - F(from)) / F(all) by parts, in extended
/// precision. Near +pi even that has ten digits left of rows as narrow as the narrowest here.
TEST(EnvironmentSampling, PolarAnglesAreTheInverseToTheLastDigits) {
  for (const int h : {3, 8, 26, 512, 8192}) {
    const EnvironmentTents tents(1, h);
    const long double step = 3.14159265358979323846264L / h;
    for (const int y : {1, h / 3, h / 2, h - 2}) {
      const long double centre = (y + 0.5L) * step;
      // Integral of (1 - |t - centre| / step) sin t from centre - step to t.
      const auto cdf = [&](long double t) {
        const auto rising = [&](long double a) {  // of (1 - (centre - a) / step) sin a
          const long double low = centre - step;
          return (sinl(a) - sinl(low) - (a - low) * cosl(a)) / step;
        };
        if (t <= centre) return rising(t);
        const long double high = centre + step;  // of (high - a) / step sin a from the centre to t
        return rising(centre) + ((step * cosl(centre) - (high - t) * cosl(t)) - (sinl(t) - sinl(centre))) / step;
      };
      const long double all = cdf(centre + step);
      for (const double u : {0.01, 0.3, 0.49, 0.51, 0.77, 0.999})
        EXPECT_NEAR(double(cdf(tents.polar(y, u).angle) / all), u, h > 1000 ? 2e-10 : 1e-11) << h << " row " << y;
    }
  }
}

/// A million dim texels beside one bright one: a float prefix sum would swallow them.
TEST(EnvironmentSampling, DimTexelsKeepTheirShare) {
  const int w = 2048, h = 1024;
  const auto map = makeMap(w, h, 0, [](int x, int y) { return x == 0 && y == 512 ? Vec3(1e6f) : Vec3(0.1f); });
  const EnvironmentDistribution d(map);
  double truth = 0;
  for (int y = 0; y < h; ++y) truth += d.texelWeight(y) * w * 0.1;
  truth += d.texelWeight(512) * (1e6 - 0.1);
  EXPECT_NEAR(d.total() / truth, 1.0, 1e-6);
  Rng rng(8);
  int dim = 0;
  const int n = 20000;
  const double share = 1.0 - d.texelWeight(512) * (1e6 - 0.1) / truth;
  for (int i = 0; i < n; ++i) {
    Vec3 dir, l;
    float pdf;
    ASSERT_TRUE(d.sample(rng.next2(), dir, l, pdf));
    const Vec2 uv = map->toUv(dir);  // what the bright texel's tent does not reach; inside it, its share of the look-up is 1e-7
    dim += !((uv.x * w < 1.5f || uv.x * w > w - 0.5f) && std::fabs(uv.y * h - 512.5f) < 1.0f);
  }
  EXPECT_NEAR(dim / double(n), share, 4.5 * std::sqrt(share * (1 - share) / n));
}

}  // namespace
}  // namespace gobo

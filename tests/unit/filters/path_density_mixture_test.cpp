// SPDX-License-Identifier: Apache-2.0
// Mixtures of Gaussians by expectation maximisation, and path density by them: known mixtures, no step down, degenerate samples, the laws of even light.
#include "filters/path_density/gaussian_mixture.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "filters/path_density/mixture_density.h"
#include "path_density_clouds.h"
#include "support/thorough.h"

namespace gobo {
namespace path_density_mixture_test {

using namespace pathdensity;
using pathdensitytest::evenSamples;
using pathdensitytest::meansOf;
using pathdensitytest::uniformSamples;
using pathdensitytest::unit;

const TaskArena& arena() {
  static const TaskArena a(2);
  return a;
}
double normal(uint64_t seed, uint64_t i, uint64_t k) {
  return std::sqrt(-2 * std::log(1 - unit(seed, i, 2 * k))) * std::cos(2 * M_PI * unit(seed, i, 2 * k + 1));
}
constexpr double kMeans[3][5] = {{0, 0, 0, 0, 0}, {6, 1, 4, 0, 0}, {1, 7, 0, 5, -3}};
constexpr double kWeights[3] = {0.5, 0.3, 0.2};
/// Three Gaussians: each of deviations 1, 0.5, ... along the axes, the first two axes correlated by 0.6.
std::vector<AxisPoint> known(size_t n, uint64_t seed) {
  std::vector<AxisPoint> points;
  for (uint64_t i = 0; i < n; ++i) {
    const double u = unit(seed, i, 100);
    const size_t j = u < 0.5 ? 0 : u < 0.8 ? 1 : 2;
    AxisPoint p;
    for (size_t c = 0; c < kAxes; ++c) p[c] = kMeans[j][c] + (c == 0 ? 1.0 : 0.5) * normal(seed, i, c);
    p[1] = kMeans[j][1] + 0.5 * (0.6 * (p[0] - kMeans[j][0]) + 0.8 * normal(seed, i, 1));
    points.push_back(p);
  }
  return points;
}
MixtureFit fitOf(int components, int iterations) {
  MixtureFit f;
  f.components = components;
  f.iterations = iterations;
  f.enough = 0;
  return f;
}
void expectKnown(const Mixture& m, double tolerance) {
  ASSERT_EQ(m.components().size(), 3u);
  for (int j = 0; j < 3; ++j) {
    const Gaussian* nearest = nullptr;
    double least = 1e9;
    for (const Gaussian& g : m.components()) {
      double away = 0;
      for (size_t c = 0; c < kAxes; ++c) away += std::pow(g.mean[c] - kMeans[j][c], 2);
      if (away < least) least = away, nearest = &g;
    }
    EXPECT_LT(std::sqrt(least), 2 * tolerance) << j;
    EXPECT_NEAR(nearest->weight, kWeights[j], tolerance) << j;
    EXPECT_NEAR(nearest->covariance[0], 1.0, 2 * tolerance) << j;
    EXPECT_NEAR(nearest->covariance[1], 0.3, tolerance) << j;
    EXPECT_NEAR(nearest->covariance[2], 0.25, tolerance) << j;
    EXPECT_NEAR(nearest->covariance[14], 0.25, tolerance) << j;
  }
}

TEST(GaussianMixture, RecoversAKnownMixture) {
  const auto points = known(20000, 3);
  expectKnown(fitMixture(points, fitOf(3, 60)), 0.03);
}

TEST(GaussianMixture, StepwiseOnPassesRecoversItToo) {
  // 40 passes of 1000 samples, each seen once but for the first, which begins: rates (t + 2)^-0.7.
  const auto all = known(40000, 4);
  const std::span<const AxisPoint> points(all);
  MixtureLearner learner(points.first(1000), fitOf(3, 0));
  for (int i = 0; i < 20; ++i) learner.step(points.first(1000));
  for (size_t t = 1; t < 40; ++t) learner.online(points.subspan(1000 * t, 1000), std::pow(double(t) + 2, -0.7));
  expectKnown(learner.mixture(), 0.06);
}

TEST(GaussianMixture, NoStepMakesTheSamplesLessLikely) {
  for (const uint64_t seed : {1u, 2u, 3u, 4u})
    for (const int components : {1, 4, 9}) {
      auto points = known(400, seed);
      // Some on a plane, some on a point, some far away: floors are at work.
      for (size_t i = 0; i < points.size(); i += 3) points[i][2] = points[i][3] = 1.0;
      for (size_t i = 0; i < points.size(); i += 5) points[i] = {2, 2, 2, 2, 2};
      for (size_t i = 0; i < points.size(); i += 97) points[i][2] = 1e4 * double(i + 1) / 400;
      MixtureFit fit = fitOf(components, 0);
      fit.seed = seed;
      MixtureLearner learner(points, fit);
      double last = -std::numeric_limits<double>::infinity();
      for (int i = 0; i < 60; ++i) {
        const double now = learner.step(points);
        EXPECT_GE(now, last - 1e-9) << seed << ", " << components << " components, step " << i;
        last = now;
      }
      double weights = 0;
      for (const Gaussian& g : learner.mixture().components()) {
        weights += g.weight;
        if (g.weight <= 0) continue;
        // At least the floor in every direction: what is left is not negative.
        Triangle beyond = g.covariance, lower;
        for (size_t c = 0; c < kAxes; ++c) beyond[c * (c + 1) / 2 + c] -= fit.floor * (1 - 1e-6);
        EXPECT_TRUE(choleskyOf(beyond, lower));
      }
      EXPECT_NEAR(weights, 1.0, 1e-9);
    }
}

TEST(GaussianMixture, DensitiesAndEigenvaluesAreThoseOfTheFormulas) {
  // One component of the identity: (2 pi)^(-5/2) exp(-r^2 / 2).
  Gaussian g;
  g.weight = 1;
  for (size_t c = 0; c < kAxes; ++c) g.covariance[c * (c + 1) / 2 + c] = 1;
  EXPECT_NEAR(Mixture({g}).logDensity({1, 0, 2, 0, 0}), -2.5 * std::log(2 * M_PI) - 2.5, 1e-12);
  // Far away no density is too small, and shares are shares.
  Gaussian h = g;
  h.mean[0] = 10;
  g.weight = h.weight = 0.5;
  double r[2] = {};
  EXPECT_NEAR(Mixture({g, h}).logDensity({1e4, 0, 0, 0, 0}, r), -0.5 * 9990.0 * 9990.0 + std::log(0.5) - 2.5 * std::log(2 * M_PI), 1e-6);
  EXPECT_EQ(r[0], 0.0);
  EXPECT_EQ(r[1], 1.0);
  Mixture({g, h}).logDensity({5, 3, 0, 0, 1}, r);
  EXPECT_NEAR(r[0], 0.5, 1e-12);
  EXPECT_EQ(Mixture().logDensity({}), -std::numeric_limits<double>::infinity());
  // 4 v v^T + the rest: eigenvalues 4 |v|^2 and 0, raised to 0.5.
  const AxisPoint v{1, -2, 0.5, 0, 3};
  double norm = 0;
  for (const double x : v) norm += x * x;
  Triangle m{};
  for (size_t i = 0; i < kAxes; ++i)
    for (size_t j = 0; j <= i; ++j) m[i * (i + 1) / 2 + j] = 4 * v[i] * v[j];
  const Triangle raised = withEigenvaluesOf(m, 0.5);
  for (size_t i = 0; i < kAxes; ++i)
    for (size_t j = 0; j <= i; ++j) EXPECT_NEAR(raised[i * (i + 1) / 2 + j], 4 * v[i] * v[j] + 0.5 * ((i == j) - v[i] * v[j] / norm), 1e-10) << i << j;
}

TEST(GaussianMixture, FewAndEqualSamples) {
  EXPECT_TRUE(fitMixture({}, fitOf(4, 5)).components().empty());
  const std::vector<AxisPoint> one(1, AxisPoint{1, 2, 3, 4, 5}), same(7, AxisPoint{1, 2, 3, 4, 5});
  for (const auto& points : {one, same}) {
    const Mixture m = fitMixture(points, fitOf(4, 5));
    ASSERT_EQ(m.components().size(), 1u);
    EXPECT_EQ(m.components()[0].weight, 1.0);
    for (size_t c = 0; c < kAxes; ++c) {
      EXPECT_NEAR(m.components()[0].mean[c], points[0][c], 1e-12);
      EXPECT_NEAR(m.components()[0].covariance[c * (c + 1) / 2 + c], 0.01, 1e-12);
    }
    EXPECT_TRUE(std::isfinite(m.logDensity({1e4, 0, 0, 0, 0})));
  }
}

Settings together(int k = 10) {
  Settings s;
  s.neighbours = k;
  s.judged = Judged::Together;
  s.spread = 0;
  return s;
}
Filtered byMixture(const SampleView& v, const Settings& s) {
  auto r = rejectByMixture(v, s, {}, arena());
  EXPECT_TRUE(r.ok()) << r.status().toString();
  return r.ok() ? *r : Filtered{};
}

TEST(PathDensityMixture, EvenLightStaysWhole) {
  for (const int n : {4, 16}) {
    const auto samples = evenSamples(40, 33, n, uint64_t(20 + n), [](uint64_t, const Vec2&) { return Vec3(0.7f, 0.2f, 0.05f); });
    for (const double share : {0.5, 1.0}) {
      const int k = int(share * mostNeighbours(n, 40, 33, together()));
      const Filtered f = byMixture(samples.view(), together(k));
      double least = 1;
      for (const float w : f.weight) least = std::min(least, double(w));
      EXPECT_GT(least, share < 1 ? 0.9999 : 0.9) << n;
      for (size_t p = 0; p < f.weight.size(); ++p) EXPECT_EQ(f.rgb[3 * p], 0.7f);
    }
    // In the middle c = 9 pi n, so that sigma is that of the law, up to what tiles ripple.
    const auto sigma = mixtureSigmasOf(samples.view(), together(10), {}, LightTerm::All, arena());
    ASSERT_TRUE(sigma.ok());
    double sum = 0, count = 0;
    for (size_t i = 0; i < sigma->size(); ++i) {
      const float x = samples.view().film[2 * i], y = samples.view().film[2 * i + 1];
      if (std::min(x, y) < 9 || x > 31 || y > 24) continue;
      sum += double((*sigma)[i]), count += 1;
    }
    const double law = 2.0 / 3.0 * std::sqrt(10 / (M_PI * n));
    EXPECT_NEAR(sum / count, law, 0.06 * law);
  }
}

TEST(PathDensityMixture, RareColoursAppearAtTheTransitionOfTheLaw) {
  // 9 pi n q = k at sigma = 2, 81 pi n q = 4 k at 3, within 25 % of n q.
  const int n = 16, k = 50, size = 64;
  const auto sigmaAt = [&](double nq) {
    double sum = 0, count = 0;
    for (uint64_t seed = 11; seed < testing::thoroughOr(13u, 12u); ++seed) {
      std::vector<bool> rare;
      const auto samples = uniformSamples(size, size, n, seed, [&](uint64_t i, const Vec2&) {
        rare.push_back(unit(seed, i, 7) < nq / n);
        return Vec3(float(std::pow((50.0 + (rare.back() ? 120.0 : 0.0) + 16.0) / 116.0, 3.0)));
      });
      const auto sigma = mixtureSigmasOf(samples.view(), together(k), {}, LightTerm::All, arena());
      EXPECT_TRUE(sigma.ok());
      for (size_t i = 0; i < rare.size(); ++i) {
        const float x = samples.view().film[2 * i], y = samples.view().film[2 * i + 1];
        if (!rare[i] || std::min(x, y) < 6 || std::max(x, y) > float(size) - 6) continue;
        sum += double((*sigma)[i]), count += 1;
      }
    }
    return sum / count;
  };
  for (const auto& [threshold, law] : {std::pair{2.0, k / (9 * M_PI)}, {3.0, 4 * k / (81 * M_PI)}}) {
    EXPECT_GT(sigmaAt(0.75 * law), threshold);
    EXPECT_LT(sigmaAt(1.25 * law), threshold);
  }
}

TEST(PathDensityMixture, AFireflyGoesThoughAComponentIsItsOwn) {
  for (const float height : {1e2f, 1e5f, 1e30f}) {
    const auto samples = evenSamples(24, 24, 16, 5, [&](uint64_t i, const Vec2&) { return Vec3(i % 911 == 7 ? height : 0.5f); });
    const Filtered f = byMixture(samples.view(), together(50));
    for (const float v : f.rgb) EXPECT_EQ(v, 0.5f);
    const auto mean = meansOf(samples.view());
    for (size_t i = 0; i < mean.size(); ++i) EXPECT_NEAR(double(f.rgb[i]) + double(f.rejected[i]), mean[i], 1e-6 * mean[i]);
  }
}

TEST(PathDensityMixture, ASampleDoesNotCorroborateItself) {
  // One neighbour is enough here: a lone bright sample has none, two of them in a pixel have each other.
  for (const int bright : {1, 2}) {
    const auto samples =
        evenSamples(16, 16, 8, 5, [&](uint64_t i, const Vec2&) { return Vec3(i >= 8 * 100 && i < 8 * 100 + uint64_t(bright) ? 50.0f : 0.5f); });
    const Filtered f = byMixture(samples.view(), together(1));
    EXPECT_NEAR(f.weight[100], bright == 1 ? 7.0 / 8 : 1.0, 0.01);
  }
}

TEST(PathDensityMixture, SameBitsForAnyThreadsEmptyPixelsAndMistakes) {
  PathSamples samples(21, 18);
  for (uint64_t i = 0; i < 21 * 18 * 6; ++i) {
    const int x = int(i / 6) % 21, y = int(i / 6) / 21;
    if (x >= 8 && x < 16 && y < 8) continue;  // a tile without a sample
    const float bright = unit(8, i, 3) < 0.03 ? 1e3f : 1.0f;
    ASSERT_TRUE(
        samples.add(x, y, Vec2(float(x) + float(unit(8, i, 0)), float(y) + float(unit(8, i, 1))), Vec3(0.1f), Vec3(float(unit(8, i, 5)), 0.2f, 0.1f) * bright)
            .ok());
  }
  const SampleView v = samples.view();
  Settings s;
  std::vector<float> expected;
  for (const int threads : {1, 3}) {
    const TaskArena some(threads);
    uint64_t components = 0;
    const auto f = rejectByMixture(v, s, {}, some, {}, &components);
    ASSERT_TRUE(f.ok()) << f.status().toString();
    if (expected.empty()) expected = f->rgb;
    EXPECT_EQ(f->rgb, expected);
    EXPECT_EQ(f->empty, 64u);
    EXPECT_GT(components, 8u);
    EXPECT_LE(components, 8u * 8u);
    for (const float r : f->rgb) EXPECT_TRUE(std::isfinite(r));
  }
  const auto refused = [&](auto change) {
    Settings own;
    MixtureSettings m;
    change(own, m);
    const auto r = rejectByMixture(v, own, m, arena());
    return !r.ok() && r.status().code() == Code::InvalidArgument;
  };
  EXPECT_TRUE(refused([](Settings&, MixtureSettings& m) { m.tile = 3; }));
  EXPECT_TRUE(refused([](Settings&, MixtureSettings& m) { m.fit.components = 0; }));
  EXPECT_TRUE(refused([](Settings&, MixtureSettings& m) { m.fit.floor = 0; }));
  EXPECT_TRUE(refused([](Settings& o, MixtureSettings&) { o.border = Border::Correct; }));
  EXPECT_TRUE(refused([](Settings& o, MixtureSettings&) { o.neighbours = 500; }));
  EXPECT_TRUE(refused([](Settings& o, MixtureSettings&) { o.metric.filmScale = 3; }));
  StopSource stop;
  stop.stop(StopReason::Cancelled);
  EXPECT_EQ(rejectByMixture(v, {}, {}, arena(), stop.token()).status().code(), Code::Cancelled);
  // One sample alone has nothing to be measured by.
  PathSamples lone(1, 1);
  ASSERT_TRUE(lone.add(0, 0, Vec2(0.5f), Vec3(0.0f), Vec3(3.0f)).ok());
  Settings few;
  few.fewer = true;
  EXPECT_EQ(byMixture(lone.view(), few).rgb[0], 3.0f);
  EXPECT_EQ(byMixture(lone.view(), few).weight[0], 1.0f);
}

}  // namespace path_density_mixture_test
}  // namespace gobo

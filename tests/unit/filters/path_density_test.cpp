// SPDX-License-Identifier: Apache-2.0
// Path-density outlier rejection: its laws, what it leaves alone, what it refuses.
#include "filters/path_density/path_density.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "filters/path_density/neighbour_search.h"
#include "filters/path_density/spread.h"
#include "path_density_clouds.h"
#include "support/thorough.h"

namespace gobo {
namespace path_density_test {

using namespace pathdensity;
using pathdensitytest::evenSamples;
using pathdensitytest::meansOf;
using pathdensitytest::uniformSamples;
using pathdensitytest::unit;

const TaskArena& arena() {
  static const TaskArena a(2);
  return a;
}
/// The source's: both kinds of light, 50 neighbours, nothing comes back.
Settings source() {
  Settings s;
  s.neighbours = 50;
  s.judged = Judged::Apart;
  s.spread = 0;
  return s;
}
Filtered filtered(const SampleView& v, const Settings& s = source()) {
  auto r = rejectOutliers(v, s, arena());
  EXPECT_TRUE(r.ok()) << r.status().toString();
  return r.ok() ? *r : Filtered{};
}
double valueAt(const std::vector<float>& rgb, const SampleView& v, int x, int y, int c) { return double(rgb[3 * size_t(y * v.width + x) + size_t(c)]); }

/// A class of share q of the samples, `away` h_c from the rest; which are even.
struct RareClass {
  PathSamples samples{1, 1};
  std::vector<bool> rare;
};
RareClass rareClass(double q, int n, int size, float away, uint64_t seed) {
  RareClass r;
  r.samples = uniformSamples(size, size, n, seed, [&](uint64_t i, const Vec2&) {
    r.rare.push_back(unit(seed, i, 7) < q);
    // Grey of L* = 50, and as much lighter as that is: Y = ((L* + 16) / 116)^3.
    return Vec3(float(std::pow((50.0 + (r.rare.back() ? 20.0 * double(away) : 0.0) + 16.0) / 116.0, 3.0)));
  });
  return r;
}

TEST(PathDensity, MeanDistanceOfEvenLightFollowsTheLaw) {
  // sigma = D / (D + 1) Gamma(k + 1 + 1/D) / Gamma(k + 1) (rho V_D)^(-1/D), D = 2.
  for (const int n : {8, 16, 40})
    for (const int k : {10, 50, 200}) {
      const auto samples = uniformSamples(60, 60, n, uint64_t(100 + n), [](uint64_t, const Vec2&) { return Vec3(0.4f); });
      Settings s = source();
      s.neighbours = k;
      const auto sigma = sigmasOf(samples.view(), s, LightTerm::All, arena());
      ASSERT_TRUE(sigma.ok());
      double sum = 0, count = 0;
      for (size_t i = 0; i < samples.size(); ++i) {
        const float x = samples.view().film[2 * i], y = samples.view().film[2 * i + 1];
        if (std::min(x, y) < 6 || std::max(x, y) > 54) continue;
        sum += double((*sigma)[i]);
        count += 1;
      }
      const double law = 2.0 / 3.0 * std::exp(std::lgamma(k + 1.5) - std::lgamma(k + 1.0)) / std::sqrt(M_PI * n);
      EXPECT_NEAR(sum / count, law, 0.015 * law) << "n " << n << ", k " << k;
      if (k == 200 && n == 16) { EXPECT_NEAR(sum / count, 1.33, 0.015); }
    }
}

TEST(PathDensity, MeanDistanceInAllFiveDimensionsFollowsTheLaw) {
  // Density 2000 a unit of the product metric's ball, volume 2 pi^2 / 15: .375 and .274 for k = 50 and 10.
  const double side = 1.7;
  for (const auto& [k, law] : {std::pair{50, 0.375}, {10, 0.274}}) {
    double sum = 0;
    constexpr int kTrials = 24;
    for (int trial = 0; trial < kTrials; ++trial) {
      PathSamples samples(2, 2);
      const uint64_t count = uint64_t(2000 * std::pow(side, 5)) + 1, seed = uint64_t(50 + trial);
      const auto place = [&](uint64_t i, uint64_t axis) { return float(i == 0 ? side / 2 : side * unit(seed, i, axis)); };
      for (uint64_t i = 0; i < count; ++i)
        ASSERT_TRUE(samples.add(place(i, 0) >= 1, place(i, 1) >= 1, Vec2(place(i, 0), place(i, 1)), Vec3(0.0f), Vec3(0.0f)).ok());
      const SampleBins bins = binSamples(samples.view());
      MetricPoints p;
      size_t middle = 0;
      for (size_t j = 0; j < bins.order.size(); ++j) {
        const uint64_t i = bins.order[j];
        if (i == 0) middle = j;
        p.x.push_back(place(i, 0));
        p.y.push_back(place(i, 1));
        p.l.push_back(place(i, 2));
        p.a.push_back(place(i, 3));
        p.b.push_back(place(i, 4));
      }
      NeighbourSearch::Scratch scratch;
      sum += double(NeighbourSearch(bins, p, 1.0f).meanDistance(middle, k, {}, scratch)) / kTrials;
    }
    EXPECT_NEAR(sum, law, 0.03 * law) << k;
  }
}

TEST(PathDensity, RareColoursAppearAtTheTransitionOfTheLaw) {
  const int n = 16, k = 50;
  Settings s = source();
  s.neighbours = k;
  const auto measured = [&](double nq, double& sigma, double& weight) {
    sigma = weight = 0;
    double count = 0;
    for (uint64_t seed = 11; seed < testing::thoroughOr(15u, 13u); ++seed) {
      const RareClass r = rareClass(nq / n, n, 64, 6.0f, seed);
      const auto sigmas = sigmasOf(r.samples.view(), s, LightTerm::All, arena());
      ASSERT_TRUE(sigmas.ok());
      for (size_t i = 0; i < r.rare.size(); ++i) {
        const float x = r.samples.view().film[2 * i], y = r.samples.view().film[2 * i + 1];
        if (!r.rare[i] || std::min(x, y) < 6 || std::max(x, y) > 58) continue;
        sigma += double((*sigmas)[i]);
        weight += double(weightOf((*sigmas)[i], s));
        count += 1;
      }
    }
    ASSERT_GT(count, 100);
    sigma /= count;
    weight /= count;
  };
  // Where the mean sigma is 2 and 3: 9 pi nq = k and 81 pi nq = 4 k, within 10 % of nq.
  for (const auto& [threshold, law] : {std::pair{2.0, k / (9 * M_PI)}, {3.0, 4 * k / (81 * M_PI)}}) {
    double before = 0, after = 0, weight = 0;
    measured(0.9 * law, before, weight);
    measured(1.1 * law, after, weight);
    EXPECT_GT(before, threshold) << law;
    EXPECT_LT(after, threshold) << law;
  }
  // The source's simulation: mean weights; they are ours at an nq that is at most 10 % another one (and 0.02 of weight, our own noise).
  // Half of the seeds: root 2 times the noise.
  const double noise = testing::thoroughOr(0.02, 0.028);
  const double table[][2] = {{0.30, 0}, {0.79, 0.02}, {1.0, 0.22}, {1.3, 0.74}, {1.77, 0.96}, {2.5, 1.0}};
  for (const auto& [nq, expected] : table) {
    double sigma = 0, below = 0, above = 0;
    measured(0.9 * nq, sigma, below);
    measured(1.1 * nq, sigma, above);
    EXPECT_LE(below, expected + noise) << nq;
    EXPECT_GE(above, expected - noise) << nq;
    if (nq > 0.5) { EXPECT_NEAR(sigma, 2.0 / 3.0 * std::sqrt(k / (M_PI * 1.1 * nq)), 0.05 * sigma) << nq; }
  }
}

TEST(PathDensity, BelowTheTransitionAnyHeightOfOutliersLeavesTheSamePicture) {
  std::vector<float> first;
  for (const float height : {1e2f, 1e5f, 1e30f}) {
    const auto samples = evenSamples(24, 24, 16, 5, [&](uint64_t i, const Vec2&) { return Vec3(unit(5, i, 7) < 0.01 ? height : 0.5f); });
    const Filtered f = filtered(samples.view());
    for (const float v : f.rgb) EXPECT_EQ(v, 0.5f);
    const auto mean = meansOf(samples.view());
    for (size_t i = 0; i < mean.size(); ++i) EXPECT_NEAR(double(f.rgb[i]) + double(f.rejected[i]), mean[i], 1e-6 * mean[i]);
  }
}

TEST(PathDensity, AboveTheTransitionTheEnergyIsThere) {
  const auto samples = evenSamples(24, 24, 60, 6, [&](uint64_t i, const Vec2&) { return Vec3(unit(6, i, 7) < 0.08 ? 40.0f : 0.5f); });
  const Filtered f = filtered(samples.view());
  const auto mean = meansOf(samples.view());
  double kept = 0, all = 0;
  for (int y = 4; y < 20; ++y)
    for (int x = 4; x < 20; ++x) {
      kept += valueAt(f.rgb, samples.view(), x, y, 0);
      all += mean[3 * size_t(y * 24 + x)];
    }
  EXPECT_NEAR(kept / all, 1.0, 0.01);
}

TEST(PathDensity, KeptAndRejectedAreTheMeanOfAllSamples) {
  for (const Judged judged : {Judged::Apart, Judged::Indirect, Judged::Together})
    for (const bool density : {true, false}) {
      PathSamples samples(19, 13);
      for (uint64_t i = 0; i < 19 * 13 * 9; ++i) {
        const int x = int(i / 9) % 19, y = int(i / 9) / 19;
        const auto firefly = [&](uint64_t k) { return unit(8, i, k) < 0.03 ? float(std::pow(10.0, 4 * unit(8, i, k + 1))) : 1.0f; };
        ASSERT_TRUE(samples
                        .add(x, y, Vec2(float(x) + float(unit(8, i, 0)), float(y) + float(unit(8, i, 1))), Vec3(0.3f, 0.4f, float(unit(8, i, 2))) * firefly(3),
                             Vec3(float(unit(8, i, 5)), 0.2f, 0.1f) * firefly(6))
                        .ok());
      }
      Settings s = source();
      s.judged = judged;
      s.density = density;
      s.spread = density ? 0.0f : 3.0f;
      const Filtered f = filtered(samples.view(), s);
      const auto mean = meansOf(samples.view());
      double rejected = 0;
      for (size_t i = 0; i < mean.size(); ++i) {
        EXPECT_NEAR(double(f.rgb[i]) + double(f.rejected[i]), mean[i], 3e-7 * (std::abs(mean[i]) + std::abs(double(f.rgb[i])))) << i;
        rejected += double(f.rejected[i]);
      }
      EXPECT_GT(std::abs(rejected), density ? 10.0 : 0.0);
      EXPECT_EQ(f.density.size(), density ? f.weight.size() : 0u);
    }
}

TEST(PathDensity, WithoutThresholdsItIsTheMeanToTheBit) {
  const auto samples = evenSamples(15, 9, 5, 9, [](uint64_t i, const Vec2&) { return Vec3(float(std::pow(10.0, 6 * unit(9, i, 4) - 3)), 0.1f, -0.3f); });
  Settings s = source();
  s.soft = s.hard = std::numeric_limits<float>::infinity();
  s.neighbours = 1000;
  const auto mean = meansOf(samples.view());
  for (const bool density : {false, true}) {
    s.density = density;
    const Filtered f = filtered(samples.view(), s);
    for (size_t i = 0; i < mean.size(); ++i) {
      EXPECT_EQ(f.rgb[i], float(mean[i]));
      EXPECT_EQ(f.rejected[i], 0.0f);
    }
    for (const float w : f.weight) EXPECT_EQ(w, 1.0f);
  }
}

TEST(PathDensity, EvenLightStaysWholeUpToSevenNeighboursASampleAndMoreIsRefused) {
  const int n = 16;
  const auto samples = evenSamples(40, 33, n, 10, [](uint64_t, const Vec2&) { return Vec3(0.7f, 0.2f, 0.05f); });
  for (const Border border : {Border::Refuse, Border::Correct}) {
    Settings s = source();
    s.border = border;
    const int most = mostNeighbours(n, 40, 33, s);
    EXPECT_EQ(most, int((border == Border::Refuse ? 2.25 : 9.0) * M_PI * n)) << "a quarter of a disc of radius 3, or all of it";
    s.neighbours = int(0.8 * most);  // what chance leaves
    s.density = true;
    const Filtered f = filtered(samples.view(), s);
    for (size_t p = 0; p < f.weight.size(); ++p) {
      EXPECT_GT(f.weight[p], 0.97f) << p;
      EXPECT_EQ(f.rgb[3 * p], 0.7f);
    }
    s.neighbours = most + 1;
    const auto refused = rejectOutliers(samples.view(), s, arena());
    ASSERT_FALSE(refused.ok());
    EXPECT_EQ(refused.status().code(), Code::InvalidArgument);
    EXPECT_NE(refused.status().message().find(std::to_string(most)), std::string::npos) << refused.status().message();
    // Unless as many will do as there may be.
    s.fewer = true;
    ASSERT_TRUE(checkNeighbours(samples.view(), s).ok());
    EXPECT_EQ(s.neighbours, most);
    s.neighbours = 5;
    ASSERT_TRUE(checkNeighbours(samples.view(), s).ok());
    EXPECT_EQ(s.neighbours, 5);
    ASSERT_TRUE(checkNeighbours(1e-3, 40, 33, s).ok());
    EXPECT_EQ(s.neighbours, 1) << "of next to no samples";
  }
  // Why: with as many neighbours as fit inside, corners would go without the correction.
  Settings s = source();
  s.neighbours = int(0.8 * 9 * M_PI * n);
  s.density = true;
  const auto uncorrected = sigmasOf(samples.view(), s, LightTerm::All, arena());
  ASSERT_TRUE(uncorrected.ok());
  EXPECT_LT(weightOf((*uncorrected)[0], s), 0.3f);
  s.border = Border::Correct;
  const auto corrected = sigmasOf(samples.view(), s, LightTerm::All, arena());
  ASSERT_TRUE(corrected.ok());
  EXPECT_EQ(weightOf((*corrected)[0], s), 1.0f);
}

TEST(PathDensity, AFireflyGoesAndAnEdgeStays) {
  const int size = 24, n = 16;
  const auto light = [](float x) { return x < 12.0f ? Vec3(0.02f, 0.03f, 0.05f) : Vec3(2.0f, 1.5f, 0.9f); };
  const auto clean = evenSamples(size, size, n, 12, [&](uint64_t, const Vec2& film) { return light(film.x); });
  const auto spotted = evenSamples(size, size, n, 12, [&](uint64_t i, const Vec2& film) { return i % 801 == 7 ? Vec3(300.0f) : light(film.x); });
  const Filtered a = filtered(clean.view()), b = filtered(spotted.view());
  for (size_t i = 0; i < a.rgb.size(); ++i) {
    EXPECT_EQ(a.rgb[i], light(float(i / 3 % size))[int(i % 3)]) << i;
    EXPECT_EQ(a.rejected[i], 0.0f) << i;
    EXPECT_EQ(b.rgb[i], a.rgb[i]) << i;
  }
  double rejected = 0;
  for (const float v : b.rejected) rejected += double(v);
  EXPECT_NEAR(rejected, 12 * 3 * 300.0 / n, 30.0);  // of 12 samples
}

TEST(PathDensity, TwoLightsOfAPixelKeepTheirShares) {
  // Yellow and blue, 80 to 20: neither is an outlier.
  const auto samples =
      evenSamples(20, 20, 32, 13, [](uint64_t i, const Vec2&) { return unit(13, i, 5) < 0.2 ? Vec3(0.1f, 0.1f, 1.5f) : Vec3(1.2f, 1.0f, 0.05f); });
  const Filtered f = filtered(samples.view());
  const auto mean = meansOf(samples.view());
  for (int y = 4; y < 16; ++y)
    for (int x = 4; x < 16; ++x)
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(valueAt(f.rgb, samples.view(), x, y, c), mean[3 * size_t(y * 20 + x) + size_t(c)], 1e-6);
}

TEST(PathDensity, TermsApartKeepDirectLightFreeOfIndirectNoise) {
  // Every sample's indirect light is an outlier of its own; direct light has a ramp.
  PathSamples samples(16, 16);
  for (uint64_t i = 0; i < 16 * 16 * 16; ++i) {
    const int x = int(i / 16) % 16, y = int(i / 16) / 16;
    const Vec2 film(float(x) + float(unit(14, i, 0)), float(y) + float(unit(14, i, 1)));
    const float indirect = unit(14, i, 2) < 0.02 ? 1000.0f : 0.0f;
    ASSERT_TRUE(samples.add(x, y, film, Vec3(0.2f + 0.01f * film.x), Vec3(indirect)).ok());
  }
  const auto errors = [&](Judged judged) {
    Settings s = source();
    s.judged = judged;
    const Filtered f = filtered(samples.view(), s);
    for (const float w : f.weight) {
      EXPECT_GE(w, 0.0f);
      EXPECT_LE(w, 1.0f);
    }
    // Against the mean of the direct light.
    double sum = 0;
    for (int y = 0; y < 16; ++y)
      for (int x = 0; x < 16; ++x) {
        double direct = 0;
        for (int k = 0; k < 16; ++k) direct += double(samples.view().direct[3 * size_t((y * 16 + x) * 16 + k)]) / 16;
        sum += std::abs(valueAt(f.rgb, samples.view(), x, y, 0) - direct);
      }
    return sum;
  };
  EXPECT_LT(errors(Judged::Apart), 1e-4);
  EXPECT_LT(errors(Judged::Indirect), 1e-4);
  EXPECT_GT(errors(Judged::Together), 1e-3);
}

TEST(PathDensity, DarkLinesKeepTheirWidthInLabButNotInRgb) {
  // Lines a pixel wide, half in one pixel and half in the next, between bright cells whose samples scatter by a factor of four. In linear RGB bright samples
  // are far from each other and dark ones close: the half of a pixel that is a line takes all of it.
  const int size = 32, n = 16;
  const auto samples = evenSamples(size, size, n, 15, [](uint64_t i, const Vec2& film) {
    const float at = film.x - 8.0f * std::floor(film.x / 8.0f);
    return at >= 4.5f && at < 5.5f ? Vec3(0.02f) : Vec3(float(2 + 6 * unit(15, i, 6)));
  });
  const auto mean = meansOf(samples.view());
  const auto keptOnLines = [&](ColourSpace space) {
    Settings s = source();
    s.metric.space = space;
    const Filtered f = filtered(samples.view(), s);
    double kept = 0, all = 0;
    for (int y = 4; y < size - 4; ++y)
      for (int x = 0; x < size; ++x) {
        if (x % 8 != 4 && x % 8 != 5) continue;
        kept += valueAt(f.rgb, samples.view(), x, y, 0);
        all += mean[3 * size_t(y * size + x)];
      }
    return kept / all;
  };
  EXPECT_NEAR(keptOnLines(ColourSpace::Lab), 1.0, 0.03);
  EXPECT_LT(keptOnLines(ColourSpace::Rgb), 0.6);
}

TEST(PathDensity, SameBitsForAnyNumberOfThreadsAndBothSearches) {
  const auto samples = evenSamples(37, 21, 11, 16, [](uint64_t i, const Vec2& film) {
    return Vec3(float(0.2 + 0.3 * unit(16, i, 3)) + 0.02f * film.x) * (unit(16, i, 4) < 0.05 ? 200.0f * float(unit(16, i, 5)) : 1.0f);
  });
  for (const bool density : {false, true}) {
    Settings s = source();
    s.density = density;
    const TaskArena one(1), five(5);
    const auto a = rejectOutliers(samples.view(), s, one), b = rejectOutliers(samples.view(), s, five);
    ASSERT_TRUE(a.ok() && b.ok());
    EXPECT_EQ(a->rgb, b->rgb);
    EXPECT_EQ(a->rejected, b->rejected);
    EXPECT_EQ(a->weight, b->weight);
    EXPECT_EQ(a->density, b->density);
    s.treeEpsilon = 0;
    const Filtered tree = filtered(samples.view(), s);
    for (size_t i = 0; i < tree.rgb.size(); ++i) EXPECT_NEAR(tree.rgb[i], a->rgb[i], 2e-5 * (1 + std::abs(double(a->rgb[i])))) << i;
    for (size_t i = 0; i < tree.density.size(); ++i) EXPECT_NEAR(tree.density[i], a->density[i], 2e-6) << i;
    double rejected[2] = {};
    s.treeEpsilon = 1;
    const Filtered rough = filtered(samples.view(), s);
    for (size_t i = 0; i < tree.weight.size(); ++i) {
      EXPECT_LE(rough.weight[i], tree.weight[i] + 1e-6);  // distances come out too large
      rejected[0] += double(tree.weight[i]);
      rejected[1] += double(rough.weight[i]);
    }
    EXPECT_LT(rejected[1], rejected[0]);
  }
}

TEST(PathDensity, TheOrderOfSamplesAndThePlaceInThePictureDoNotMatter) {
  const auto light = [](uint64_t i) { return Vec3(float(0.2 + 0.3 * unit(17, i, 3))) * (unit(17, i, 4) < 0.05 ? 30.0f : 1.0f); };
  PathSamples forwards(40, 40), backwards(40, 40), moved(40, 40);
  const uint64_t count = 20 * 20 * 12;
  const auto place = [](uint64_t i, float by) { return Vec2(by + 20.0f * float(unit(17, i, 0)), by + 20.0f * float(unit(17, i, 1))); };
  const auto add = [&](PathSamples& to, uint64_t i, float by) {
    const Vec2 film = place(i, by);
    ASSERT_TRUE(to.add(int(film.x), int(film.y), film, light(i), Vec3(0.0f)).ok());
  };
  for (uint64_t i = 0; i < count; ++i) {
    add(forwards, i, 3.0f);
    add(backwards, count - 1 - i, 3.0f);
    add(moved, i, 14.0f);
  }
  Settings s = source();
  s.neighbours = 20;
  const auto a = sigmasOf(forwards.view(), s, LightTerm::All, arena()), b = sigmasOf(backwards.view(), s, LightTerm::All, arena()),
             c = sigmasOf(moved.view(), s, LightTerm::All, arena());
  ASSERT_TRUE(a.ok() && b.ok() && c.ok());
  for (size_t i = 0; i < count; ++i) {
    EXPECT_NEAR((*a)[i], (*b)[count - 1 - i], 1e-6 * (1 + (*a)[i]));
    EXPECT_NEAR((*a)[i], (*c)[i], 1e-4 * (1 + (*a)[i]));
  }
}

TEST(PathDensity, SamplesTakenSeveralTimesNeverCountLess) {
  const auto once = evenSamples(14, 14, 9, 18, [](uint64_t i, const Vec2&) { return Vec3(float(unit(18, i, 3))) * (unit(18, i, 4) < 0.1 ? 20.0f : 1.0f); });
  PathSamples thrice(14, 14);
  const SampleView v = once.view();
  for (int times = 0; times < 3; ++times)
    for (size_t i = 0; i < v.size(); ++i) {
      const Vec2 film(v.film[2 * i], v.film[2 * i + 1]);
      ASSERT_TRUE(thrice.add(int(film.x), int(film.y), film, Vec3(v.direct[3 * i], v.direct[3 * i + 1], v.direct[3 * i + 2]), Vec3(0.0f)).ok());
    }
  const auto a = sigmasOf(once.view(), source(), LightTerm::All, arena()), b = sigmasOf(thrice.view(), source(), LightTerm::All, arena());
  ASSERT_TRUE(a.ok() && b.ok());
  for (size_t i = 0; i < a->size(); ++i) EXPECT_LE((*b)[i], (*a)[i] * (1 + 1e-6f));
}

TEST(PathDensity, HardCases) {
  Settings s = source();
  // No sample at all; one; a picture of one pixel whose other samples are all of them.
  const PathSamples none(3, 2);
  Filtered f = filtered(none.view(), s);
  EXPECT_EQ(f.rgb, std::vector<float>(18, 0.0f));
  EXPECT_EQ(f.empty, 6u);
  PathSamples one(3, 3);
  ASSERT_TRUE(one.add(1, 2, Vec2(1.5f, 2.5f), Vec3(5.0f), Vec3(0.0f)).ok());
  s.neighbours = 1;
  s.border = Border::Correct;
  f = filtered(one.view(), s);
  EXPECT_EQ(f.rgb, std::vector<float>(27, 5.0f));  // the empty ones show it too
  EXPECT_EQ(f.empty, 8u);
  const auto pixel = evenSamples(1, 1, 64, 19, [](uint64_t i, const Vec2&) { return Vec3(i == 20 ? 1e4f : 0.5f); });
  s.neighbours = 50;
  f = filtered(pixel.view(), s);
  EXPECT_EQ(f.rgb[0], 0.5f);
  s.border = Border::Refuse;
  f = filtered(pixel.view(), s);
  EXPECT_EQ(f.rgb[0], 0.5f);
  // Every sample of a pixel rejected: the one of least sigma stands for it.
  PathSamples lonely(21, 21);
  for (uint64_t i = 0; i < 21 * 21 * 16; ++i) {
    const int x = int(i / 16) % 21, y = int(i / 16) / 21;
    const bool alone = x == 10 && y == 10;
    const Vec2 film(float(x) + float(unit(20, i, 0)), float(y) + float(unit(20, i, 1)));
    ASSERT_TRUE(lonely.add(x, y, film, alone ? Vec3(100.0f * float(1 + i % 16)) : Vec3(0.1f), Vec3(0.0f)).ok());
  }
  f = filtered(lonely.view());
  EXPECT_EQ(f.allRejected, 1u);
  const float stands = f.rgb[3 * (10 * 21 + 10)];
  const auto sigma = sigmasOf(lonely.view(), source(), LightTerm::Direct, arena());
  ASSERT_TRUE(sigma.ok());
  const auto first = sigma->begin() + (10 * 21 + 10) * 16;
  EXPECT_EQ(stands, 100.0f * float(1 + (std::min_element(first, first + 16) - first)));
  EXPECT_NEAR(stands + f.rejected[3 * (10 * 21 + 10)], 850.0f, 1e-3f);
  EXPECT_EQ(f.weight[10 * 21 + 10], 0.5f) << "of two terms: there is no indirect light to reject";
}

TEST(PathDensity, DensityMapsTellWhatCorroborates) {
  const auto samples =
      evenSamples(20, 20, 16, 21, [](uint64_t i, const Vec2& film) { return film.x < 10 ? Vec3(0.4f) : Vec3(float(unit(21, i, 3) * unit(21, i, 4) * 9)); });
  Settings s = source();
  s.density = true;
  const Filtered f = filtered(samples.view(), s);
  const auto sigma = sigmasOf(samples.view(), s, LightTerm::Direct, arena());
  ASSERT_TRUE(sigma.ok());
  double even = 0, uneven = 0;
  for (int y = 4; y < 16; ++y) {
    even += double(f.density[size_t(y * 20 + 4)]) / 12;
    uneven += double(f.density[size_t(y * 20 + 15)]) / 12;
  }
  EXPECT_GT(even, uneven + 0.02);
  // The mean of exp(-sigma^2 / 2) / sqrt(2 pi) over samples and both terms; indirect light is even.
  const auto black = sigmasOf(samples.view(), s, LightTerm::Indirect, arena());
  ASSERT_TRUE(black.ok());
  for (const int p : {4 * 20 + 4, 10 * 20 + 15}) {
    double mean = 0;
    for (int k = 0; k < 16; ++k)
      for (const auto* one : {&*sigma, &*black}) {
        const double v = double((*one)[size_t(p * 16 + k)]);
        mean += std::exp(-v * v / 2) / std::sqrt(2 * M_PI) / 32;
      }
    EXPECT_NEAR(double(f.density[size_t(p)]), mean, 1e-5);
  }
  EXPECT_NEAR(double(densityOf(2.0f)), 0.05399, 1e-5);
  EXPECT_NEAR(double(densityOf(3.0f)), 0.00443, 1e-5);
}

TEST(PathDensity, SpreadingKeepsTheEnergyAndEdgesAndIsBounded) {
  const int width = 40, height = 24, sigma = 2;
  std::vector<double> kept(size_t(3 * width * height)), rejected(kept.size(), 0.0);
  for (size_t i = 0; i < kept.size(); ++i) kept[i] = int(i / 3) % width < 20 ? 0.01 : 1.0;
  const size_t at = 3 * size_t(12 * width + 21);  // next to the edge
  rejected[at] = 5;
  const std::vector<double> before = kept;
  auto run = [&](double most) {
    auto k = before, r = rejected;
    EXPECT_TRUE(spreadRejected(k, r, width, height, sigma, most, arena(), {}));
    for (size_t i = 0; i < k.size(); ++i) EXPECT_NEAR(k[i] + r[i], before[i] + rejected[i], 1e-12);
    return k;
  };
  const auto spread = run(1e6);
  double more = 0, dark = 0, reach = 0;
  for (size_t i = 0; i < spread.size(); ++i) {
    more += spread[i] - before[i];
    if (before[i] < 0.5) dark += spread[i] - before[i];
    if (spread[i] > before[i]) reach = std::max(reach, std::abs(double(int(i / 3) % width) - 21));
    if (i % 3 != 0) { EXPECT_EQ(spread[i], before[i]); }
  }
  EXPECT_NEAR(more, 5.0, 1e-9);
  EXPECT_LT(dark, 0.05);
  EXPECT_EQ(reach, 6);
  // The Gaussian, in proportion to what is there.
  const size_t away = at + 3 * 3;
  EXPECT_NEAR((spread[away] - 1) / (spread[at] - 1), std::exp(-9.0 / 8), 1e-9);
  rejected[at] = 1e30;
  for (const double most : {0.0, 0.5}) {
    const auto bounded = run(most);
    for (size_t i = 0; i < bounded.size(); ++i) EXPECT_LE(bounded[i], before[i] * (1 + most) * (1 + 1e-12));
    EXPECT_EQ(bounded[at], 1 + most);
  }
  rejected[at] = -1e30;
  for (const double v : run(1.0)) EXPECT_GE(v, 0.0);
}

TEST(PathDensity, WhatIsSpreadIsTheTermsOwnAndNoOutlierGlares) {
  const auto samples = evenSamples(24, 24, 16, 24, [&](uint64_t i, const Vec2&) {
    return Vec3(i == 16 * (12 * 24 + 12) ? 1e20f : i % 400 == 3 ? 5.0f : 0.5f);
  });
  Settings s = source();
  s.spread = 4;
  s.judged = Judged::Together;
  const Filtered f = filtered(samples.view(), s);
  double sum = 0;
  for (const float v : f.rgb) {
    EXPECT_LE(v, 1.0f);
    EXPECT_GE(v, 0.5f);
    sum += double(v);
  }
  EXPECT_GT(sum / (24 * 24 * 3), 0.505);
  s.judged = Judged::Indirect;  // of which there is none
  const auto mean = meansOf(samples.view());
  const Filtered none = filtered(samples.view(), s);
  for (size_t i = 0; i < mean.size(); ++i) EXPECT_EQ(none.rgb[i], float(mean[i]));
}

TEST(PathDensity, WhatItRefuses) {
  auto samples = evenSamples(8, 8, 16, 22, [](uint64_t, const Vec2&) { return Vec3(1.0f); });
  const auto refuses = [&](const std::function<void(Settings&)>& change, const std::string& why) {
    Settings s = source();
    change(s);
    const auto r = rejectOutliers(samples.view(), s, arena());
    ASSERT_FALSE(r.ok()) << why;
    EXPECT_EQ(r.status().code(), Code::InvalidArgument);
    EXPECT_NE(r.status().message().find(why), std::string::npos) << r.status().message();
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  refuses([](Settings& s) { s.neighbours = 0; }, "neighbours");
  refuses([](Settings& s) { s.neighbours = 1000; }, "too many");
  refuses([](Settings& s) { s.metric.filmScale = 0; }, "film scale");
  refuses([&](Settings& s) { s.metric.colourScale = nan; }, "colour scale");
  refuses([](Settings& s) { s.metric.white = -1; }, "white");
  refuses([](Settings& s) { s.soft = 4; }, "thresholds");
  refuses([&](Settings& s) { s.hard = nan; }, "thresholds");
  refuses([](Settings& s) { s.soft = -1; }, "thresholds");
  refuses([](Settings& s) { s.spread = -1; }, "spread");
  refuses([&](Settings& s) { s.mostSpread = nan; }, "most spread");
  samples.markCorrelated();
  refuses([](Settings&) {}, "correlated");
  EXPECT_FALSE(sigmasOf(samples.view(), source(), LightTerm::All, arena()).ok());
}

TEST(PathDensity, StopsAreNoticed) {
  const auto samples = evenSamples(30, 30, 16, 23, [](uint64_t i, const Vec2&) { return Vec3(float(unit(23, i, 2))); });
  StopSource stop;
  stop.stop(StopReason::Cancelled);
  EXPECT_EQ(rejectOutliers(samples.view(), source(), arena(), stop.token()).status().code(), Code::Cancelled);
  for (const int poll : {1, 3, 9, 20}) {
    StopSource later;
    later.stopAtPoll(poll);
    EXPECT_EQ(rejectOutliers(samples.view(), source(), arena(), later.token()).status().code(), Code::Cancelled) << poll;
  }
}

TEST(PathSamples, AreBoundedAndFinite) {
  PathSamples samples(4, 4, 10 * PathSamples::kBytesOfSample + 3);
  const float inf = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
  ASSERT_TRUE(samples.add(1, 1, Vec2(1.5f), Vec3(nan, 0, 0), Vec3(0.0f)).ok());
  ASSERT_TRUE(samples.add(1, 1, Vec2(1.5f), Vec3(0.0f), Vec3(0, inf, 0)).ok());
  ASSERT_TRUE(samples.add(1, 1, Vec2(1.5f, nan), Vec3(0.0f), Vec3(0.0f)).ok());
  ASSERT_TRUE(samples.add(1, 1, Vec2(1.5f), Vec3(3e38f), Vec3(3e38f)).ok());
  EXPECT_EQ(samples.dropped(), 4u);
  EXPECT_EQ(samples.size(), 0u);
  EXPECT_FALSE(samples.reserve(11).ok());
  for (int i = 0; i < 10; ++i) ASSERT_TRUE(samples.add(1, 2, Vec2(2.0f, 1.9f), Vec3(1.0f), Vec3(0.0f)).ok());
  const Status full = samples.add(1, 2, Vec2(1.5f, 2.5f), Vec3(1.0f), Vec3(0.0f));
  EXPECT_EQ(full.code(), Code::ResourceExhausted);
  EXPECT_NE(full.message().find(std::to_string(10 * PathSamples::kBytesOfSample + 3)), std::string::npos) << full.message();
  EXPECT_EQ(samples.size(), 10u);
  EXPECT_LE(samples.bytes(), 10 * PathSamples::kBytesOfSample + 3);
  // A film position on the far edge counts for the pixel that it was drawn for.
  EXPECT_LT(samples.view().film[0], 2.0f);
  EXPECT_GE(samples.view().film[0], 1.999f);
  EXPECT_EQ(samples.view().film[1], 2.0f);
}

}  // namespace path_density_test
}  // namespace gobo

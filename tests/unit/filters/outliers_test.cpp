// SPDX-License-Identifier: Apache-2.0
// Estimators that resist outliers: breakdown points, limits, energy.
#include <gtest/gtest.h>

#include <cmath>

#include "filters/outliers/picture_filters.h"
#include "filters/outliers/sample_estimators.h"
#include "filters/outliers/smoothing_filters.h"
#include "path_density_clouds.h"

namespace gobo {
namespace outliers_test {

using namespace outliers;
using pathdensity::binSamples;
using pathdensity::PathSamples;
using pathdensitytest::evenSamples;
using pathdensitytest::meansOf;
using pathdensitytest::unit;

/// One pixel of these samples, grey.
PathSamples pixelOf(const std::vector<float>& values) {
  PathSamples s(1, 1);
  for (const float v : values) EXPECT_TRUE(s.add(0, 0, Vec2(0.5f), Vec3(v), Vec3(0.0f)).ok());
  return s;
}
template <class F>
float estimate(const std::vector<float>& values, F&& f) {
  const PathSamples s = pixelOf(values);
  return f(s.view(), binSamples(s.view()))[0];
}
auto trimmedBy(double share) {
  return [share](const auto& v, const auto& b) { return trimmedMean(v, b, share); };
}
auto medianOfMeansOf(int buckets) {
  return [buckets](const auto& v, const auto& b) { return adaptiveMedianOfMeans(v, b, buckets); };
}

TEST(Outliers, TrimmedMeansGoFromTheMeanToTheMedian) {
  const std::vector<float> v{5, 1, 100, 2, 4, 3, 6, 7, 8, 9};
  EXPECT_EQ(estimate(v, trimmedBy(0.0)), 14.5f);
  EXPECT_EQ(estimate(v, trimmedBy(0.1)), 5.5f);
  EXPECT_EQ(estimate(v, trimmedBy(0.5)), 5.5f);
  EXPECT_NEAR(estimate(v, trimmedBy(0.05)), (0.5 * 1 + 44 + 0.5 * 100) / 9, 1e-5);  // halves of the ends
  EXPECT_EQ(estimate({3}, trimmedBy(0.5)), 3.0f);
  EXPECT_EQ(estimate({3, 5}, trimmedBy(0.5)), 4.0f);
}

TEST(Outliers, BreakdownPoints) {
  // 20 samples of 1 with m outliers: the estimator holds up to its share of them.
  const auto with = [](int m) {
    std::vector<float> v(20, 1.0f);
    for (int i = 0; i < m; ++i) v[size_t(i)] = 1e6f;
    return v;
  };
  EXPECT_GT(estimate(with(1), trimmedBy(0.0)), 1e4f);
  EXPECT_EQ(estimate(with(2), trimmedBy(0.1)), 1.0f);
  EXPECT_GT(estimate(with(3), trimmedBy(0.1)), 1e4f);
  EXPECT_EQ(estimate(with(9), trimmedBy(0.5)), 1.0f);
  EXPECT_GT(estimate(with(11), trimmedBy(0.5)), 1e5f);
  EXPECT_EQ(estimate(with(1), medianOfMeansOf(5)), 1.0f);
  EXPECT_EQ(estimate(with(1), medianOfMeansOf(1)), estimate(with(1), trimmedBy(0.0)));
}

TEST(Outliers, TheMedianIsLessEfficientThanTheMeanByTwoOverPi) {
  double mean = 0, median = 0;
  constexpr int kTrials = 4000, kSamples = 101;
  for (int t = 0; t < kTrials; ++t) {
    std::vector<float> v;
    for (int i = 0; i < kSamples; ++i) {
      double g = -6;
      for (uint64_t k = 0; k < 12; ++k) g += unit(uint64_t(t), uint64_t(i), k);
      v.push_back(float(g));
    }
    mean += std::pow(double(estimate(v, trimmedBy(0.0))), 2) / kTrials;
    median += std::pow(double(estimate(v, trimmedBy(0.5))), 2) / kTrials;
  }
  EXPECT_NEAR(mean / median, 2 / M_PI, 0.05);
}

TEST(Outliers, GiniCoefficientsDecideHowManyMeansAreLeftOut) {
  EXPECT_EQ(giniCoefficient({2, 2, 2, 2}), 0.0);
  EXPECT_EQ(giniCoefficient({0, 0, 0, 8}), 0.75);  // (n - 1) / n
  EXPECT_DOUBLE_EQ(giniCoefficient({1, 2, 3}), 2.0 / 9);
  EXPECT_EQ(giniCoefficient({-3, 1}), 0.0);
  // Alike: the mean of all. (G = 2 / 9, 3 means: floor(1 / 3) left out.)
  EXPECT_EQ(estimate({1, 2, 3}, medianOfMeansOf(3)), 2.0f);
  // {1, 1, 1, 2, 20}: G = 0.608, 5 means: one is left out at each end.
  EXPECT_NEAR(estimate({1, 20, 1, 2, 1}, medianOfMeansOf(5)), 4.0 / 3, 1e-6);
  // Buckets are an odd number, filled round robin: {(1 + 4) / 2, 2, 3}.
  EXPECT_NEAR(estimate({1, 2, 3, 4}, medianOfMeansOf(4)), 2.5, 1e-6);
}

TEST(Outliers, ReweightingDropsALoneFireflyAndKeepsWhatNeighboursHaveToo) {
  const auto picture = [](double q, uint64_t seed, int n) {
    return evenSamples(12, 12, n, seed, [=](uint64_t i, const Vec2&) { return Vec3(unit(seed, i, 5) < q ? 500.0f : 0.5f); });
  };
  // Alone: one in the middle.
  const auto lone = evenSamples(12, 12, 16, 1, [](uint64_t i, const Vec2&) { return Vec3(i == 16 * (6 * 12 + 6) ? 500.0f : 0.5f); });
  const auto out = reweightedMean(lone.view(), binSamples(lone.view()));
  EXPECT_NEAR(out[3 * (6 * 12 + 6)], 0.5 * 15 / 16, 1e-6);  // its own part is missing
  EXPECT_EQ(out[0], 0.5f);
  // Many: all energy is there.
  const auto many = picture(0.2, 2, 32);
  const auto all = reweightedMean(many.view(), binSamples(many.view()));
  const auto mean = meansOf(many.view());
  for (size_t i = 0; i < mean.size(); ++i) EXPECT_NEAR(double(all[i]), mean[i], 1e-4 * mean[i]);
  // Whatever there is below the lowest cascade stays, black and negative light too.
  EXPECT_EQ(estimate({-1, 0.25, 0, 0.5}, [](const auto& v, const auto& b) { return reweightedMean(v, b); }), -0.0625f);
}

TEST(Outliers, MediansOfPicturesTakeSpikesAndLeaveRamps) {
  const int w = 9, h = 7;
  std::vector<float> ramp(size_t(3 * w * h)), spiked;
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
      for (int c = 0; c < 3; ++c) ramp[size_t(3 * (y * w + x) + c)] = 1.0f + 0.5f * float(x);
  spiked = ramp;
  spiked[3 * (3 * w + 4)] = 900.0f;
  const auto median = medianFilter(spiked, w, h), outliers = medianOfOutliers(spiked, w, h);
  EXPECT_EQ(median[3 * (3 * w + 4)], 3.0f + 0.0f * median[0]);
  EXPECT_LE(outliers[3 * (3 * w + 4)], 3.5f);
  const auto kept = medianOfOutliers(ramp, w, h);
  for (int y = 0; y < h; ++y)
    for (int x = 1; x < w - 1; ++x) EXPECT_EQ(kept[size_t(3 * (y * w + x))], ramp[size_t(3 * (y * w + x))]) << x;
  std::vector<float> noise(size_t(3 * w * h));
  for (size_t i = 0; i < noise.size(); ++i) noise[i] = float(unit(7, i, 0));
  EXPECT_EQ(medianOfOutliers(noise, w, h, 1, 1e9), noise);
  EXPECT_NE(medianOfOutliers(noise, w, h, 1, 1.0), noise);
  // Half of the window and more: the median fails.
  std::vector<float> corrupted(size_t(3 * 9), 1.0f);
  for (int i = 0; i < 5; ++i) corrupted[size_t(3 * i)] = 50.0f;
  EXPECT_EQ(medianFilter(corrupted, 3, 3)[3 * 4], 50.0f);
}

TEST(Outliers, SpreadingKeepsTheEnergy) {
  const int w = 31, h = 23;
  std::vector<float> rgb(size_t(3 * w * h), 0.25f);
  for (const int p : {0, 5 * w + 7, 11 * w + 30, 22 * w + 15}) rgb[size_t(3 * p)] = rgb[size_t(3 * p + 1)] = 80.0f;
  const auto out = spreadOutliers(rgb, w, h);
  double before = 0, after = 0;
  float most = 0;
  for (size_t i = 0; i < rgb.size(); ++i) {
    before += double(rgb[i]);
    after += double(out[i]);
    most = std::max(most, out[i]);
  }
  EXPECT_NEAR(after, before, 1e-5 * before);
  EXPECT_LT(most, 2.0f);
  const std::vector<float> even(size_t(3 * w * h), 0.7f);
  EXPECT_EQ(spreadOutliers(even, w, h), even);
}

TEST(Outliers, SmoothingKeepsEdgesAndWithThemSpikes) {
  const int w = 21, h = 15;
  std::vector<float> rgb(size_t(3 * w * h));
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
      for (int c = 0; c < 3; ++c) rgb[size_t(3 * (y * w + x) + c)] = (x < 10 ? 0.2f : 1.0f) + 0.01f * float(unit(3, uint64_t(y * w + x), uint64_t(c)));
  const size_t spike = size_t(3 * (7 * w + 5));
  rgb[spike] = 9.0f;
  double before = 0, after = 0;
  const auto bilateral = bilateralFilter(rgb, w, h, 2.0, 0.1), diffused = anisotropicDiffusion(rgb, w, h, 8, 0.1);
  for (const auto* out : {&bilateral, &diffused}) {
    EXPECT_NEAR((*out)[spike], 9.0f, 1e-3f);  // why they are not enough
    EXPECT_NEAR((*out)[size_t(3 * (3 * w + 9))], 0.205f, 0.004f);
    EXPECT_NEAR((*out)[size_t(3 * (3 * w + 10))], 1.005f, 0.004f);
  }
  for (size_t i = 0; i < rgb.size(); ++i) {
    before += double(rgb[i]);
    after += double(diffused[i]);
  }
  EXPECT_NEAR(after, before, 1e-4);
  // Limits of the range: the picture; a Gaussian.
  const auto same = bilateralFilter(rgb, w, h, 2.0, 1e-6);
  for (size_t i = 0; i < rgb.size(); ++i) EXPECT_EQ(same[i], rgb[i]);
  std::vector<float> impulse(size_t(3 * w * h), 0.0f);
  impulse[size_t(3 * (7 * w + 10))] = 1;
  const auto gaussian = bilateralFilter(impulse, w, h, 1.0, 1e9);
  const auto at = [&](int dx, int dy) { return double(gaussian[size_t(3 * ((7 + dy) * w + 10 + dx))]); };
  EXPECT_NEAR(at(1, 0) / at(0, 0), std::exp(-0.5), 1e-5);
  EXPECT_NEAR(at(1, 2) / at(0, 0), std::exp(-2.5), 1e-5);
  EXPECT_EQ(at(3, 0), 0.0);
  // Diffusion below the edge's height levels out.
  const auto level = anisotropicDiffusion(impulse, w, h, 4000, 1e6);
  for (int p = 0; p < w * h; ++p) EXPECT_NEAR(level[size_t(3 * p)], 1.0f / float(w * h), 1e-4f);
}

}  // namespace outliers_test
}  // namespace gobo

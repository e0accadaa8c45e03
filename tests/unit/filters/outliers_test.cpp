// SPDX-License-Identifier: Apache-2.0
// Estimators that resist outliers: breakdown points, limits, energy.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "base/vec.h"
#include "filters/outliers/picture_filters.h"
#include "filters/outliers/sample_estimators.h"
#include "filters/outliers/smoothing_filters.h"
#include "path_density_clouds.h"
#include "support/stopping.h"

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

/// Re-weighting as it is written down: whole pictures of each cascade, at most `most` of them.
std::vector<float> reweightedByPictures(const pathdensity::SampleView& s, const SampleBins& all, const SampleBins& part, const Reweighting& r, int most) {
  const double start = double(r.start), base = double(r.base);
  const int count = std::clamp(int(std::log(3.0e38 / start) / std::log(base)) + 2, 2, most);
  const auto startOf = [&](int k) { return start * std::pow(base, k); };
  using Pictures = std::map<int, std::vector<DVec3>>;
  const auto cascadesOf = [&](const SampleBins& bins) {
    Pictures light;
    const auto at = [&](int k, size_t p) -> DVec3& { return light.try_emplace(k, size_t(s.width) * size_t(s.height), DVec3(0.0)).first->second[p]; };
    for (int y = 0; y < s.height; ++y)
      for (int x = 0; x < s.width; ++x)
        for (size_t i = bins.pixelBegin(x, y); i < bins.pixelEnd(x, y); ++i) {
          const size_t p = size_t(y) * size_t(s.width) + size_t(x), j = 3 * size_t(bins.order[i]);
          const DVec3 v = DVec3(double(s.direct[j]), double(s.direct[j + 1]), double(s.direct[j + 2])) +
                          DVec3(double(s.indirect[j]), double(s.indirect[j + 1]), double(s.indirect[j + 2]));
          const double l = 0.2126 * v.x + 0.7152 * v.y + 0.0722 * v.z;
          if (!(l > start)) {
            at(0, p) += v;
            continue;
          }
          const int k = std::min(int(std::log(l / start) / std::log(base)), count - 2);
          const double low = std::clamp((startOf(k) / l - 1 / base) / (1 - 1 / base), 0.0, 1.0);
          at(k, p) += low * v;
          at(k + 1, p) += (1 - low) * v;
        }
    return light;
  };
  const Pictures of = cascadesOf(all), summed = cascadesOf(part);
  std::vector<float> out(3 * size_t(s.width) * size_t(s.height), 0.0f);
  for (int y = 0; y < s.height; ++y)
    for (int x = 0; x < s.width; ++x) {
      const double n = double(part.pixelEnd(x, y) - part.pixelBegin(x, y));
      const size_t p = size_t(y) * size_t(s.width) + size_t(x);
      DVec3 sum(0.0);
      for (const auto& [k, light] : summed) {
        if (light[p] == DVec3(0.0)) continue;
        double around = 0;
        for (int v = std::max(y - 1, 0); v <= std::min(y + 1, s.height - 1); ++v)
          for (int u = std::max(x - 1, 0); u <= std::min(x + 1, s.width - 1); ++u)
            for (int j = k - 1; j <= k + 1; ++j) {
              if (!of.count(j)) continue;
              const DVec3& there = of.at(j)[size_t(v) * size_t(s.width) + size_t(u)];
              around += std::max(0.0, 0.2126 * there.x + 0.7152 * there.y + 0.0722 * there.z) / startOf(j);
            }
        sum += (k == 0 ? 1.0 : std::clamp((around - 1) / (double(r.enough) - 1), 0.0, 1.0)) * light[p];
      }
      for (int c = 0; c < 3 && n > 0; ++c) out[3 * p + size_t(c)] = float(std::clamp(sum[c] / n, -3.4e38, 3.4e38));
    }
  return out;
}

/// The first samples of each pixel.
SampleBins firstOf(const SampleBins& bins, size_t most) {
  SampleBins b = bins;
  b.order.clear();
  b.slotStart.assign(1, 0);
  for (size_t slot = 0; slot + 1 < bins.slotStart.size(); ++slot) {
    const size_t begin = bins.slotStart[slot], end = std::min<size_t>(bins.slotStart[slot + 1], begin + most);
    b.order.insert(b.order.end(), bins.order.begin() + ptrdiff_t(begin), bins.order.begin() + ptrdiff_t(end));
    b.slotStart.push_back(uint32_t(b.order.size()));
  }
  return b;
}

// Tiles, threads and what is kept of the cascades change no bit; of fewer than 160 cascades, all that there once were, neither does their number.
TEST(Outliers, ReweightingByTilesIsReweightingByPictures) {
  const TaskArena one(1), three(3);
  const struct { int width, height, samples; } sizes[] = {{1, 1, 9}, {33, 2, 7}, {3, 97, 4}, {32, 32, 3}, {67, 35, 5}};
  uint64_t seed = 20;
  for (const auto& size : sizes) {
    // Brightness over 20 powers of ten, some of it below zero, and many of about the same.
    const auto light = [&](uint64_t i, const Vec2&) {
      const double kind = unit(seed, i, 5), bright = std::pow(10.0, kind < 0.5 ? unit(seed, i, 6) : 24 * unit(seed, i, 6) - 4);
      return Vec3(float(bright), float(bright * unit(seed, i, 7)), float(kind > 0.9 ? -0.1 * bright : 0.3 * bright));
    };
    const auto samples = ++seed % 2 ? evenSamples(size.width, size.height, size.samples, seed, light)
                                    : pathdensitytest::uniformSamples(size.width, size.height, size.samples, seed, light);  // some pixels have none
    const auto view = samples.view();
    const SampleBins all = binSamples(view), part = firstOf(all, 2);
    for (const float base : {1.1f, 1.5f, 2.1f, 8.0f, 1000.0f})
      for (const float start : {1e-12f, 1.0f}) {
        SCOPED_TRACE(std::to_string(size.width) + "x" + std::to_string(size.height) + " base " + std::to_string(base) + " start " + std::to_string(start));
        const Reweighting r{start, base, 3.0f};
        const auto whole = reweightedByPictures(view, all, all, r, 1 << 20), ofPart = reweightedByPictures(view, all, part, r, 1 << 20);
        if (base > 2) { EXPECT_EQ(whole, reweightedByPictures(view, all, all, r, 160)); }
        for (const Rows& rows : {Rows{}, Rows{&one, {}}, Rows{&three, {}}}) {
          EXPECT_EQ(reweightedMean(view, all, r, rows), whole);
          EXPECT_EQ(reweightedPart(view, all, part, r, rows), ofPart);
        }
      }
  }
}

// Cascades 1.1 apart reach 3.8e6 with their 160th: what is brighter is judged all the same.
TEST(Outliers, ReweightingDropsFirefliesOfAnyBrightnessByAnyBase) {
  for (const float base : {1.1f, 1.3f, 8.0f, 1000.0f})
    for (const float firefly : {1e7f, 1e9f, 1e20f, 3e38f}) {
      const auto lone = evenSamples(12, 12, 16, 1, [&](uint64_t i, const Vec2&) { return Vec3(i == 16 * (6 * 12 + 6) ? firefly : 0.5f); });
      const auto view = lone.view();
      const SampleBins bins = binSamples(view);
      const auto out = reweightedMean(view, bins, {1.0f, base, 4.0f}), mean = meanPicture(view, bins);
      EXPECT_GT(*std::max_element(mean.begin(), mean.end()), 0.01f * firefly);
      const float most = *std::max_element(out.begin(), out.end());
      EXPECT_LE(double(most), 0.5 + 1e-9 * double(firefly)) << base << " " << firefly;
    }
}

// Two cascades a sample, whatever `base`, and no more pixels than some tiles have.
TEST(Outliers, WhatReweightingHoldsGrowsNeitherWithItsBaseNorWithThePicture) {
  const auto bytes = [](int width, int height, uint64_t samples, float base) { return reweightingBytes(width, height, samples, {1e-12f, base, 4.0f}); };
  EXPECT_EQ(bytes(1920, 1080, 16, 1.1f), bytes(1920, 1080, 16, 2.0f));
  EXPECT_GT(bytes(1920, 1080, 16, 1.1f), bytes(1920, 1080, 16, 1000.0f));  // that are fewer than 32
  EXPECT_EQ(bytes(1920, 1080, 16, 1.1f), bytes(16384, 16384, 16, 1.1f));
  EXPECT_LE(bytes(1920, 1080, 16, 1.1f), 64ull << 20);
  EXPECT_LE(bytes(16384, 16384, 1 << 20, 1.1f), 2ull << 30);
  // Of few pixels it is no more than what they have.
  EXPECT_LE(bytes(1, 1, 16, 1.1f), 4096u);
}

TEST(Outliers, ReweightingStopsBetweenRows) {
  const auto samples = evenSamples(70, 40, 4, 3, [](uint64_t i, const Vec2&) { return Vec3(float(unit(3, i, 5))); });
  const auto view = samples.view();
  const SampleBins bins = binSamples(view);
  const int polls = gobo::tests::pollsOf([&](const StopToken& stop) { reweightedMean(view, bins, {}, {nullptr, stop}); });
  EXPECT_GE(polls, 3 * 40);  // three tiles across
  // Rows that were not begun are black.
  const auto some = reweightedMean(view, bins, {}, {nullptr, gobo::tests::stopAt(20)});
  EXPECT_EQ(std::count(some.begin() + 3 * 70 * 20, some.end(), 0.0f), 3 * 70 * 20);
  const auto none = reweightedMean(view, bins, {}, {nullptr, gobo::tests::stoppedAlready()});
  EXPECT_EQ(std::count(none.begin(), none.end(), 0.0f), 3 * 70 * 40);
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

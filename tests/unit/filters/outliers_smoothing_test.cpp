// SPDX-License-Identifier: Apache-2.0
// Mean-shift filtering and the bilateral grid: closed forms, the exact bilateral filter, edges, what is not finite, threads.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>

#include "filters/outliers/bilateral_grid.h"
#include "filters/outliers/mean_shift.h"
#include "filters/path_density/metric.h"
#include "path_density_clouds.h"

namespace gobo {
namespace outliers_smoothing_test {

using namespace outliers;
using pathdensitytest::unit;

std::vector<float> pictureOf(int w, int h, const std::function<Vec3(int x, int y)>& colour) {
  std::vector<float> rgb;
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      const Vec3 v = colour(x, y);
      for (int c = 0; c < 3; ++c) rgb.push_back(v[c]);
    }
  return rgb;
}
std::vector<float> noise(int w, int h, float mean, float spread, uint64_t seed) {
  return pictureOf(w, h, [&](int x, int y) {
    Vec3 v;
    for (int c = 0; c < 3; ++c) v[c] = mean + spread * (float(unit(seed, uint64_t(y * w + x), uint64_t(c))) - 0.5f);
    return v;
  });
}
double sumOf(const std::vector<float>& v) {
  double sum = 0;
  for (const float x : v) sum += double(x);
  return sum;
}
double varianceOf(const std::vector<float>& v) {
  double squares = 0;
  const double mean = sumOf(v) / double(v.size());
  for (const float x : v) squares += (double(x) - mean) * (double(x) - mean);
  return squares / double(v.size());
}

using Filter = std::function<std::vector<float>(const std::vector<float>&, int, int, const Rows&)>;
const std::pair<const char*, Filter> kFilters[] = {
    {"mean shift", [](const std::vector<float>& v, int w, int h, const Rows& rows) { return meanShift(v, w, h, {}, rows); }},
    {"bilateral grid", [](const std::vector<float>& v, int w, int h, const Rows& rows) { return bilateralGrid(v, w, h, {}, rows); }},
};

TEST(SmoothingRivals, ConstantPicturesOfAnySizeStay) {
  for (const auto& [name, filter] : kFilters)
    for (const auto& [w, h] : {std::pair(1, 1), {1, 7}, {13, 1}, {37, 41}, {2, 2}, {64, 33}})
      for (const Vec3& colour : {Vec3(0.0f), Vec3(0.3f, 0.7f, 0.1f), Vec3(-0.2f, 0.1f, 0.0f), Vec3(3e7f, 2e7f, 1e7f), Vec3(1e-30f)}) {
        const auto in = pictureOf(w, h, [&](int, int) { return colour; });
        const auto out = filter(in, w, h, {});
        ASSERT_EQ(out.size(), in.size());
        for (size_t i = 0; i < in.size(); ++i) ASSERT_NEAR(out[i], in[i], 1e-6 * std::fabs(in[i])) << name << " " << w << "x" << h;
      }
}

TEST(SmoothingRivals, StepsWiderThanTheRangeAndSpikesStayAndNoiseGoes) {
  const int w = 33, h = 29;
  for (const auto& [name, filter] : kFilters) {
    const auto step = pictureOf(w, h, [](int x, int) { return Vec3(x < 16 ? 0.2f : 0.9f); });
    const auto kept = filter(step, w, h, {});
    for (size_t i = 0; i < step.size(); ++i) ASSERT_NEAR(kept[i], step[i], 1e-6) << name;
    auto spiked = noise(w, h, 0.4f, 0.04f, 3);
    const size_t spike = size_t(3 * (14 * w + 11));
    const double before = varianceOf(spiked);
    for (size_t c = 0; c < 3; ++c) spiked[spike + c] = 50.0f;
    auto out = filter(spiked, w, h, {});
    for (size_t c = 0; c < 3; ++c) {
      EXPECT_NEAR(out[spike + c], 50.0f, 1e-3f) << name;  // why they are not enough
      out[spike + c] = 0.4f;
    }
    EXPECT_LT(varianceOf(out), 0.1 * before) << name;
    EXPECT_NEAR(sumOf(out) / double(out.size()), 0.4, 0.002) << name;
  }
}

/// Values are means of the picture's by channel: none beyond its own. Sums move, by less than the range a pixel.
TEST(SmoothingRivals, StayWithinThePictureAndKeepItsSumToAPartOfTheRange) {
  const int w = 40, h = 31;
  for (const auto& [name, filter] : kFilters) {
    const auto in = pictureOf(w, h, [&](int x, int y) {
      const float u = float(unit(9, uint64_t(y * w + x), 0));
      return Vec3(0.1f + 0.6f * u * u * u * u, 0.3f * u, 0.2f + 0.01f * float(x));
    });
    const auto out = filter(in, w, h, {});
    for (size_t c = 0; c < 3; ++c) {
      float lo = in[c], hi = in[c];
      for (size_t i = c; i < in.size(); i += 3) {
        lo = std::min(lo, in[i]);
        hi = std::max(hi, in[i]);
      }
      for (size_t i = c; i < in.size(); i += 3) ASSERT_TRUE(out[i] >= lo * (1 - 1e-6f) && out[i] <= hi * (1 + 1e-6f)) << name;
    }
    EXPECT_NE(out, in) << name;
    EXPECT_NEAR(sumOf(out) / sumOf(in), 1.0, 0.03) << name;
    std::printf("  %s: sum over the picture's %.4f\n", name, sumOf(out) / sumOf(in));
  }
}

TEST(SmoothingRivals, WhatIsNotFiniteStaysAndCountsForNothing) {
  const int w = 19, h = 17;
  const float inf = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
  for (const auto& [name, filter] : kFilters) {
    const auto even = pictureOf(w, h, [](int, int) { return Vec3(0.5f, 0.25f, 0.125f); });
    auto in = even;
    const std::pair<size_t, float> bad[] = {{3 * (5 * w + 5) + 1, nan}, {3 * (5 * w + 6), inf}, {3 * (9 * w + 2) + 2, -inf}, {0, nan}};
    for (const auto& [at, v] : bad) in[at] = v;
    const auto out = filter(in, w, h, {});
    for (const auto& [at, v] : bad) EXPECT_EQ(std::memcmp(&out[at], &in[at], sizeof(float)), 0) << name;
    for (size_t i = 0; i < in.size(); ++i) {
      if (!std::isfinite(in[i])) continue;
      EXPECT_NEAR(out[i], even[i], 1e-6) << name << " " << i;
    }
    // In the dark too, where what stands for it would be alike.
    const auto dark = pictureOf(w, h, [](int, int) { return Vec3(1e-4f); });
    auto holed = dark;
    for (const auto& [at, v] : bad) holed[at] = v;
    const auto filled = filter(holed, w, h, {});
    for (size_t i = 0; i < dark.size(); ++i) {
      if (!std::isfinite(holed[i])) continue;
      EXPECT_NEAR(filled[i], dark[i], 1e-9) << name << " " << i;
    }
    // The largest there are, and a picture of nothing finite.
    auto huge = even;
    huge[3 * 40] = huge[3 * 40 + 1] = huge[3 * 40 + 2] = 3.4e38f;
    for (const float v : filter(huge, w, h, {})) EXPECT_TRUE(std::isfinite(v)) << name;
    const std::vector<float> none(size_t(3 * w * h), nan);
    for (const float v : filter(none, w, h, {})) EXPECT_TRUE(std::isnan(v)) << name;
  }
}

TEST(SmoothingRivals, SameBitsForAnyNumberOfThreads) {
  const int w = 61, h = 97;  // several bands of cells
  const auto in = noise(w, h, 0.5f, 0.9f, 5);
  for (const int threads : {5, 1}) {
    const TaskArena arena(threads);
    for (const auto& [name, filter] : kFilters) {
      const auto alone = filter(in, w, h, {});
      EXPECT_NE(alone, in);
      EXPECT_EQ(filter(in, w, h, {&arena}), alone) << name << ", " << threads << " threads";
    }
  }
}

/// Rows are filtered in bands, columns all together: a picture on its side gives the same.
TEST(SmoothingRivals, KnowNoRowsFromColumns) {
  const int w = 31, h = 97;
  const auto in = noise(w, h, 0.5f, 0.7f, 6);
  const auto turned = [](const std::vector<float>& v, int width, int height) {
    return pictureOf(height, width, [&](int x, int y) {
      const size_t p = size_t(3 * (x * width + y));
      return Vec3(v[p], v[p + 1], v[p + 2]);
    });
  };
  for (const auto& [name, filter] : kFilters) {
    const auto upright = filter(in, w, h, {}), lying = turned(filter(turned(in, w, h), h, w, {}), h, w);
    for (size_t i = 0; i < in.size(); ++i) ASSERT_NEAR(lying[i], upright[i], 1e-6) << name;
  }
}

TEST(SmoothingRivals, ScaleWithThePictureAndItsWhite) {
  const int w = 23, h = 18;
  const auto in = noise(w, h, 0.5f, 0.6f, 8);
  auto brighter = in;
  for (float& v : brighter) v *= 8.0f;
  const auto shifted = meanShift(in, w, h), shiftedBrighter = meanShift(brighter, w, h, {4.0, 8.0, 8.0f, 50});
  const auto gridded = bilateralGrid(in, w, h), griddedBrighter = bilateralGrid(brighter, w, h, {2.0, 0.1, 8.0});
  for (size_t i = 0; i < in.size(); ++i) {
    ASSERT_EQ(shiftedBrighter[i], 8.0f * shifted[i]);
    ASSERT_NEAR(griddedBrighter[i], 8.0f * gridded[i], 1e-5);
  }
}

/// With a window over all of the picture each pixel walks to the mean of its cluster of colours.
TEST(MeanShift, PixelsOfTwoClustersEndAtTheirMeans) {
  const int w = 9, h = 7;
  const auto isRed = [](int x, int y) { return (x * 5 + y * 3) % 7 < 3; };
  const auto in = pictureOf(w, h, [&](int x, int y) {
    const float u = 0.02f * float(unit(4, uint64_t(y * w + x), 0));
    return isRed(x, y) ? Vec3(0.6f + u, 0.1f, 0.1f) : Vec3(0.1f, 0.3f + u, 0.5f);
  });
  DVec3 means[2] = {DVec3(0.0), DVec3(0.0)};
  double counts[2] = {};
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      const size_t p = size_t(3 * (y * w + x));
      means[isRed(x, y)] += DVec3(in[p], in[p + 1], in[p + 2]);
      ++counts[isRed(x, y)];
    }
  const auto out = meanShift(in, w, h, {100.0, 8.0, 1.0f, 50});
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(out[size_t(3 * (y * w + x) + c)], means[isRed(x, y)][c] / counts[isRed(x, y)], 1e-6) << x << "," << y;
}

/// One step: the mean of the light within both windows, by hand. More steps: the walk moves on over the film.
TEST(MeanShift, WalksFromMeanToMean) {
  std::vector<float> row;
  for (const float v : {0.10f, 0.11f, 0.14f, 0.15f, 0.9f}) row.insert(row.end(), {v, v, v});
  std::vector<float> r, g, b;
  for (size_t i = 0; i < row.size(); i += 3) {
    r.push_back(row[i]);
    g.push_back(row[i]);
    b.push_back(row[i]);
  }
  pathdensity::labOf(r.data(), g.data(), b.data(), int(r.size()));
  // The window has 1.5 pixels and 6 units. Pixel 0 reaches pixel 1 alone; their mean lies at 0.5, from which 1.5 pixels reach pixel 2.
  ASSERT_LT(r[1] - r[0], 5.0f);
  ASSERT_LT(r[2] - 0.5f * (r[0] + r[1]), 6.0f);
  ASSERT_GT(r[4] - r[3], 30.0f);
  const auto first = meanShift(row, 5, 1, {1.5, 6.0, 1.0f, 1});
  EXPECT_NEAR(first[0], (0.10 + 0.11) / 2, 1e-6);
  EXPECT_NEAR(first[3], (0.10 + 0.11 + 0.14) / 3, 1e-6);
  const auto second = meanShift(row, 5, 1, {1.5, 6.0, 1.0f, 2});
  EXPECT_NEAR(second[0], (0.10 + 0.11 + 0.14) / 3, 1e-6);
  EXPECT_EQ(second[12], 0.9f);
}

TEST(MeanShift, TheWindowIsADisk) {
  const auto in = noise(3, 3, 0.5f, 0.05f, 12);
  const auto out = meanShift(in, 3, 3, {1.2, 50.0, 1.0f, 1});
  for (size_t c = 0; c < 3; ++c) {
    double sum = 0;
    for (const size_t p : {1, 3, 4, 5, 7}) sum += double(in[3 * p + c]) / 5;
    EXPECT_NEAR(out[3 * 4 + c], sum, 1e-6);
  }
}

TEST(BilateralGrid, BeyondAMillionWhitesAllAreAlike) {
  const auto in = pictureOf(12, 9, [](int x, int) { return Vec3(x < 6 ? 2e6f : 8e6f); });
  const auto mixed = bilateralGrid(in, 12, 9), apart = bilateralGrid(in, 12, 9, {2.0, 0.1, 1e3});
  EXPECT_GT(mixed[3 * 5], 3e6f);
  EXPECT_NEAR(apart[3 * 5], 2e6f, 1.0f);
}

/// The exact filter in the grid's brightness, not cut off below 5 standard deviations.
std::vector<float> exactBilateral(const std::vector<float>& rgb, int w, int h, const BilateralGrid& s) {
  std::vector<float> out(rgb.size());
  const auto brightness = [&](int x, int y) {
    const size_t p = size_t(3 * (y * w + x));
    const double luminance = 0.2126 * rgb[p] + 0.7152 * rgb[p + 1] + 0.0722 * rgb[p + 2];
    return std::log1p(std::max(luminance, 0.0) / s.white);
  };
  const int reach = int(5 * s.space);
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      DVec3 sum(0.0);
      double weights = 0;
      for (int v = std::max(y - reach, 0); v <= std::min(y + reach, h - 1); ++v)
        for (int u = std::max(x - reach, 0); u <= std::min(x + reach, w - 1); ++u) {
          const double df = (brightness(u, v) - brightness(x, y)) / s.range, away = double((u - x) * (u - x) + (v - y) * (v - y)) / (s.space * s.space);
          const double weight = std::exp(-0.5 * (away + df * df));
          const size_t q = size_t(3 * (v * w + u));
          sum += weight * DVec3(rgb[q], rgb[q + 1], rgb[q + 2]);
          weights += weight;
        }
      for (int c = 0; c < 3; ++c) out[size_t(3 * (y * w + x) + c)] = float(sum[c] / weights);
    }
  return out;
}

TEST(BilateralGrid, AgreesWithTheExactFilter) {
  const int w = 61, h = 47;
  const auto smooth = pictureOf(w, h, [](int x, int y) {
    return Vec3(0.5f + 0.4f * std::sin(0.11f * float(x)) * std::cos(0.08f * float(y)), 0.4f + 0.003f * float(x), 0.3f + 0.1f * std::cos(0.05f * float(y)));
  });
  const auto edged = pictureOf(w, h, [&](int x, int y) {
    const float u = float(unit(2, uint64_t(y * w + x), 0)) - 0.5f;
    return Vec3((x + y < 50 ? 0.3f : 0.8f) + 0.1f * u);
  });
  const struct {
    const char* name;
    const std::vector<float>& picture;
    BilateralGrid settings;
    double most, rms;
  } cases[] = {{"smooth", smooth, {2.0, 0.1, 1.0}, 0.011, 0.0013},
               {"smooth, wide", smooth, {5.0, 0.3, 1.0}, 0.018, 0.0026},
               {"edge and noise", edged, {2.0, 0.1, 1.0}, 0.006, 0.0014},
               {"edge and noise, wide", edged, {4.0, 0.2, 0.5}, 0.03, 0.0026}};
  for (const auto& c : cases) {
    const auto grid = bilateralGrid(c.picture, w, h, c.settings), exact = exactBilateral(c.picture, w, h, c.settings);
    double most = 0, squares = 0, moved = 0;
    for (size_t i = 0; i < grid.size(); ++i) {
      most = std::max(most, std::fabs(double(grid[i]) - double(exact[i])));
      squares += std::pow(double(grid[i]) - double(exact[i]), 2) / double(grid.size());
      moved += std::pow(double(c.picture[i]) - double(exact[i]), 2) / double(grid.size());
    }
    std::printf("  %s: largest %.5f, RMS %.5f where the exact filter moves %.5f\n", c.name, most, std::sqrt(squares), std::sqrt(moved));
    EXPECT_LT(most, c.most) << c.name;
    EXPECT_LT(std::sqrt(squares), c.rms) << c.name;
    EXPECT_LT(std::sqrt(squares), 0.2 * std::sqrt(moved)) << c.name;
  }
}

}  // namespace outliers_smoothing_test
}  // namespace gobo

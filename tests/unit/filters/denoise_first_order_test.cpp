// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "denoise_spatial_pictures.h"
#include "filters/denoise/first_order/first_order.h"
#include "filters/denoise/first_order/regression.h"

namespace gobo {
namespace denoise_first_order_test {

using denoisespatial::Denoised;
using denoisespatial::denoised;
using denoisespatial::facets;
using denoisespatial::noise01;
using denoisespatial::SpatialPicture;

constexpr int kAll = denoise::kRegressors;

v1::FirstOrderDenoise settings(uint32_t radius, uint32_t patch, double damping = 0.5) {
  v1::FirstOrderDenoise s;
  s.set_radius_px(radius);
  s.set_patch_px(patch);
  s.set_damping(damping);
  return s;
}

std::array<double, kAll> featuresAt(const SpatialPicture& p, size_t i) {
  std::array<double, kAll> x{1};
  if (!(p.coverage[i] > 0)) return x;
  for (size_t c = 0; c < 3; ++c) {
    x[1 + c] = p.albedo[3 * i + c];
    x[4 + c] = p.normal[3 * i + c];
  }
  x[7] = p.depth[i] > 0 ? 10 * std::log(double(p.depth[i])) : 0;
  return x;
}

/// The header's sums and systems in double, by Gaussian elimination; half a by the weights of b.
std::vector<double> byDefinition(const SpatialPicture& p, const v1::FirstOrderDenoise& s) {
  const int radius = int(s.radius_px()), f = int(s.patch_px());
  const double k2 = s.damping() * s.damping();
  const auto clampedAt = [&](int x, int y) { return p.at(std::clamp(x, 0, p.width - 1), std::clamp(y, 0, p.height - 1)); };
  const auto weight = [&](int x, int y, int u, int v) {
    double distance = 0;
    for (int j = -f; j <= f; ++j)
      for (int i = -f; i <= f; ++i) {
        double pixel = 0;
        for (size_t c = 0; c < 3; ++c) {
          const size_t a = 3 * clampedAt(x + i, y + j) + c, b = 3 * clampedAt(u + i, v + j) + c;
          const double d = double(p.b[a]) - p.b[b], va = 2 * double(p.variance[a]), vb = 2 * double(p.variance[b]);
          pixel += (d * d - va - std::min(va, vb)) / (k2 * (va + vb) + 1e-12 * (double(p.b[a]) * p.b[a] + double(p.b[b]) * p.b[b]) + 1e-30);
        }
        distance += std::clamp(pixel, -1e4, 1e4);
      }
    return std::exp(-std::max(distance / (3 * (2 * f + 1) * (2 * f + 1)), 0.0));
  };
  std::vector<double> sum(p.a.size(), 0.0), total(p.a.size(), 0.0);
  for (int y = 0; y < p.height; ++y)
    for (int x = 0; x < p.width; ++x) {
      const auto own = featuresAt(p, p.at(x, y));
      double system[kAll][kAll + 3] = {};
      const auto window = [&](const auto& body) {
        for (int v = std::max(y - radius, 0); v <= std::min(y + radius, p.height - 1); ++v)
          for (int u = std::max(x - radius, 0); u <= std::min(x + radius, p.width - 1); ++u) {
            auto apart = featuresAt(p, p.at(u, v));
            for (size_t j = 1; j < kAll; ++j) apart[j] -= own[j];
            body(p.at(u, v), apart, weight(x, y, u, v));
          }
      };
      window([&](size_t q, const auto& apart, double w) {
        for (size_t i = 0; i < kAll; ++i) {
          for (size_t j = 0; j < kAll; ++j) system[i][j] += w * apart[i] * apart[j];
          for (size_t c = 0; c < 3; ++c) system[i][kAll + c] += w * apart[i] * double(p.a[3 * q + c]);
        }
      });
      double mean[3];
      for (int c = 0; c < 3; ++c) mean[c] = system[0][kAll + c] / system[0][0];
      for (int i = 1; i < kAll; ++i) system[i][i] += denoise::kRidge * system[0][0];
      for (int i = 0; i < kAll; ++i)
        for (int r = 0; r < kAll; ++r) {
          if (r == i) continue;
          const double times = system[r][i] / system[i][i];
          for (int j = i; j < kAll + 3; ++j) system[r][j] -= times * system[i][j];
        }
      window([&](size_t q, const auto& apart, double w) {
        for (size_t c = 0; c < 3; ++c) {
          double value = 0;
          for (size_t i = 0; i < kAll; ++i) value += system[i][kAll + c] / system[i][i] * apart[i];
          sum[3 * q + c] += w * std::clamp(value, std::min(0.0, 4 * mean[c]), std::max(0.0, 4 * mean[c]));
          total[3 * q + c] += w;
        }
      });
    }
  for (size_t i = 0; i < sum.size(); ++i) sum[i] /= total[i];
  return sum;
}

TEST(DenoiseFirstOrder, IsTheFitOfItsDefinition) {
  for (const auto& s : {settings(3, 1), settings(4, 2, 1.0)}) {
    const SpatialPicture p = facets(25, 21, 31);
    const Denoised out = denoised(*denoise::makeFirstOrder(s), p);
    const std::vector<double> expected = byDefinition(p, s);
    for (size_t i = 0; i < expected.size(); ++i) ASSERT_NEAR(out.a[i], expected[i], 1e-3 * std::abs(expected[i])) << i;
  }
}

// Light that features explain survives a window in which every pixel counts alike, where means would blur it: an edge of albedo, and normals that turn.
TEST(DenoiseFirstOrder, KeepsWhatFeaturesExplain) {
  SpatialPicture p(48, 40);
  const auto truth = [&](int x, int, int) { return 1.0f + (x < 24 ? 0.0f : 1.0f) + 0.8f * std::sin(0.3f * float(x)); };
  for (int y = 0; y < p.height; ++y)
    for (int x = 0; x < p.width; ++x) {
      const size_t i = p.at(x, y);
      for (size_t c = 0; c < 3; ++c) p.albedo[3 * i + c] = x < 24 ? 0.2f : 0.7f;
      p.normal[3 * i] = std::sin(0.3f * float(x));
      p.normal[3 * i + 2] = std::cos(0.3f * float(x));
    }
  p.light(77, 0.3f, truth);
  for (float& v : p.variance) v = 1e6f;  // patches say nothing: all weights are 1
  const Denoised out = denoised(*denoise::makeFirstOrder(settings(6, 1)), p);
  double own = 0, left = 0;
  for (int y = 8; y < 32; ++y)
    for (int x = 8; x < 40; ++x) {
      const size_t i = 3 * p.at(x, y);
      own += std::pow(p.a[i] - truth(x, y, 0), 2);
      left += std::pow(out.a[i] - truth(x, y, 0), 2);
    }
  EXPECT_LT(std::sqrt(left), 0.15 * std::sqrt(own));
}

// A half is a linear filter of itself, whose weights come from the other: what is added to it comes out as it would alone.
TEST(DenoiseFirstOrder, AHalfIsNotWeighedByItself) {
  SpatialPicture p = facets(30, 24, 51), more = p, added = p;
  for (size_t i = 0; i < p.a.size(); ++i) {
    added.a[i] = 0.5f * noise01(3, i);
    more.a[i] = p.a[i] + added.a[i];
  }
  const auto filter = denoise::makeFirstOrder(settings(3, 1));
  const Denoised of = denoised(*filter, p), both = denoised(*filter, more), alone = denoised(*filter, added);
  size_t bounded = 0;  // where the bounds of predictions act it is not linear
  for (size_t i = 0; i < p.a.size(); ++i) bounded += std::abs(both.a[i] - of.a[i] - alone.a[i]) > 1e-3f;
  EXPECT_LT(bounded, p.a.size() / 20);
  EXPECT_EQ(of.b.size(), both.b.size());
}

// Two pixels that differ in a feature by little and in light by much: what the slope would say elsewhere is bounded.
TEST(DenoiseFirstOrder, PredictionsStayNearTheirWindow) {
  SpatialPicture p(24, 24);
  p.light(5, 0.0f, [](int x, int, int) { return x == 4 ? 3.0f : 1.0f; });
  for (int y = 0; y < p.height; ++y)
    for (int x = 0; x < p.width; ++x) p.albedo[3 * p.at(x, y)] = x == 4 ? 0.6f : x == 7 ? 50.0f : 0.5f;
  for (float& v : p.variance) v = 1e6f;
  const Denoised out = denoised(*denoise::makeFirstOrder(settings(3, 0)), p);
  for (const float v : out.a) {
    EXPECT_GE(v, 0.0f);
    EXPECT_LE(v, 4 * 3.0f);
  }
}

// Of a system whose features say nothing the constant is the mean.
TEST(DenoiseFirstOrder, NoFeatureNoSlope) {
  float sums[denoise::kSums] = {}, fit[denoise::kFit];
  sums[0] = 20;
  for (int c = 0; c < 3; ++c) sums[denoise::kProducts + c * kAll] = 20.0f * float(c + 1);
  denoise::solveFit(sums, 1, fit);
  for (int c = 0; c < 3; ++c)
    for (int i = 0; i < kAll; ++i) EXPECT_NEAR(fit[c * kAll + i], i == 0 ? float(c + 1) : 0.0f, 1e-6f);
}

}  // namespace denoise_first_order_test
}  // namespace gobo

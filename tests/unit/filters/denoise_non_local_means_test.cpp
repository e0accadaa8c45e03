// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "denoise_spatial_pictures.h"
#include "filters/denoise/non_local_means/non_local_means.h"
#include "filters/denoise/similar.h"

namespace gobo {
namespace denoise_non_local_means_test {

using denoisespatial::Denoised;
using denoisespatial::denoised;
using denoisespatial::facets;
using denoisespatial::SpatialPicture;

v1::NonLocalMeansDenoise settings(uint32_t radius, uint32_t patch, double damping = 0.5, double features = 0.6) {
  v1::NonLocalMeansDenoise s;
  s.set_radius_px(radius);
  s.set_patch_px(patch);
  s.set_damping(damping);
  s.set_features(features);
  return s;
}

/// The formula of the header, in double.
std::vector<double> byDefinition(const SpatialPicture& p, const v1::NonLocalMeansDenoise& s, bool half) {
  const std::vector<float>&in = half ? p.b : p.a, &guide = half ? p.a : p.b;
  const int radius = int(s.radius_px()), f = int(s.patch_px());
  const double k2 = s.damping() * s.damping(), wide = s.features() > 0 ? 1 / (s.features() * s.features()) : 0;
  const denoise::Features features{p.albedo, p.normal, p.position, p.depth, p.footprint, p.coverage};
  const denoise::Alike by{float(10 * wide), float(8 * wide), float(0.05 * wide)};
  const auto clampedAt = [&](int x, int y) { return p.at(std::clamp(x, 0, p.width - 1), std::clamp(y, 0, p.height - 1)); };
  std::vector<double> out(in.size());
  for (int y = 0; y < p.height; ++y)
    for (int x = 0; x < p.width; ++x) {
      double weights = 0, sum[3] = {};
      for (int v = std::max(y - radius, 0); v <= std::min(y + radius, p.height - 1); ++v)
        for (int u = std::max(x - radius, 0); u <= std::min(x + radius, p.width - 1); ++u) {
          double distance = 0;
          for (int j = -f; j <= f; ++j) {
            double row = 0;
            for (int i = -f; i <= f; ++i) {
              double pixel = 0;
              for (size_t c = 0; c < 3; ++c) {
                const size_t a = 3 * clampedAt(x + i, y + j) + c, b = 3 * clampedAt(u + i, v + j) + c;
                const double d = double(guide[a]) - guide[b], va = 2 * double(p.variance[a]), vb = 2 * double(p.variance[b]);
                pixel += (d * d - va - std::min(va, vb)) / (k2 * (va + vb) + 1e-12 * (double(guide[a]) * guide[a] + double(guide[b]) * guide[b]) + 1e-30);
              }
              row += std::clamp(pixel, -1e4, 1e4);
            }
            distance += row;
          }
          distance /= 3 * (2 * f + 1) * (2 * f + 1);
          const double w = std::exp(-std::max(distance, 0.0)) * double(denoise::similarity(features, p.at(x, y), p.at(u, v), by));
          weights += w;
          for (size_t c = 0; c < 3; ++c) sum[c] += w * double(in[3 * p.at(u, v) + c]);
        }
      for (size_t c = 0; c < 3; ++c) out[3 * p.at(x, y) + c] = sum[c] / weights;
    }
  return out;
}

TEST(DenoiseNonLocalMeans, IsTheSumOfItsDefinition) {
  for (const auto& s : {settings(3, 2), settings(2, 0, 1.0, 0.0), settings(4, 3, 0.3, 2.0)}) {
    const SpatialPicture p = facets(37, 29, 11);
    const Denoised out = denoised(*denoise::makeNonLocalMeans(s), p);
    for (const bool half : {false, true}) {
      const std::vector<double> expected = byDefinition(p, s, half);
      for (size_t i = 0; i < expected.size(); ++i) ASSERT_NEAR((half ? out.b : out.a)[i], expected[i], 2e-4 * std::abs(expected[i])) << half << " at " << i;
    }
  }
}

TEST(DenoiseNonLocalMeans, ChangesNothingWithRadiusZero) {
  const SpatialPicture p = facets(20, 10, 3);
  const Denoised out = denoised(*denoise::makeNonLocalMeans(settings(0, 3)), p);
  EXPECT_EQ(out.a, p.a);
  EXPECT_EQ(out.b, p.b);
}

// What a outlier in one half does to that half's weights: nothing. It is averaged away, where its own patch would have kept it.
TEST(DenoiseNonLocalMeans, AHalfIsNotWeighedByItself) {
  SpatialPicture p(31, 31);
  p.light(5, 0.1f, [](int, int, int) { return 1.0f; });
  const Denoised before = denoised(*denoise::makeNonLocalMeans(settings(5, 1)), p);
  for (size_t c = 0; c < 3; ++c) p.a[3 * p.at(15, 15) + c] += 100;
  const Denoised after = denoised(*denoise::makeNonLocalMeans(settings(5, 1)), p);
  double gained = 0;
  for (size_t i = 0; i < 31 * 31; ++i) gained += double(after.a[3 * i]) - before.a[3 * i];
  EXPECT_NEAR(gained, 100, 25);                // its energy is all there,
  EXPECT_LT(after.a[3 * p.at(15, 15)], 4.0f);  // and nowhere much of it
  EXPECT_GT(after.b[3 * p.at(15, 15)], 0.9f);
}

TEST(DenoiseNonLocalMeans, NoiseOfAPlainFallsAndEdgesStay) {
  SpatialPicture p(64, 48);
  p.light(9, 0.1f, [](int x, int, int) { return x < 32 ? 1.0f : 3.0f; });  // ten standard deviations
  const Denoised out = denoised(*denoise::makeNonLocalMeans(settings(7, 3, 0.5, 0.6)), p);
  double noise = 0, edge = 0, own = 0;
  int count = 0, along = 0;
  for (int y = 8; y < 40; ++y)
    for (int x = 8; x < 56; ++x) {
      const size_t i = 3 * p.at(x, y);
      const double truth = x < 32 ? 1 : 3, error = (out.a[i] / truth - 1) * (out.a[i] / truth - 1);
      if (std::abs(x - 31.5) < 2) edge += error, ++along;
      else noise += error, own += (p.a[i] / truth - 1) * (p.a[i] / truth - 1), ++count;
    }
  EXPECT_LT(std::sqrt(noise / count), 0.25 * std::sqrt(own / count));
  EXPECT_LT(std::sqrt(edge / along), 0.1);
}

TEST(DenoiseNonLocalMeans, WithoutHalvesTheMeanIsFiltered) {
  SpatialPicture p = facets(24, 20, 7);
  p.halves = false;
  SpatialPicture twice = p;
  twice.halves = true;
  twice.a = twice.b = p.mean;
  for (float& v : twice.variance) v *= 0.5f;  // a half has twice the variance of the mean: that of the picture without halves
  const auto filter = denoise::makeNonLocalMeans(settings(4, 2));
  EXPECT_EQ(denoised(*filter, p).a, denoised(*filter, twice).a);
}

}  // namespace denoise_non_local_means_test
}  // namespace gobo

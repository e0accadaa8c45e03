// SPDX-License-Identifier: Apache-2.0
// The joint bilateral filter against sums of std::exp in double, and what any mean with weights must do.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <numbers>

#include "filters/denoise/joint_bilateral/joint_bilateral.h"
#include "unit/filters/denoise_spatial_pictures.h"

namespace {

using namespace gobo;
using namespace gobo::denoisespatial;

struct BilateralSettings {
  int radius = 8;
  double albedo = 0.1, normal = 15, plane = 2;
  denoise::DenoiserPtr make() const {
    v1::JointBilateralDenoise s;
    s.set_radius_px(uint32_t(radius));
    s.set_albedo(albedo);
    s.set_normal_deg(normal);
    s.set_plane_px(plane);
    return denoise::makeJointBilateral(s);
  }
};

/// As the headers of the filter and of similar.h say it.
double alike(const SpatialPicture& p, size_t i, size_t j, const BilateralSettings& s) {
  if (i == j) return 1;
  const bool hit = p.coverage[i] > 0;
  if (hit != (p.coverage[j] > 0)) return 0;
  if (!hit) return 1;
  double albedo = 0, dot = 0, nn = 0, mm = 0, alongI = 0, alongJ = 0;
  for (size_t c = 0; c < 3; ++c) {
    const double n = p.normal[3 * i + c], m = p.normal[3 * j + c], d = double(p.position[3 * j + c]) - double(p.position[3 * i + c]);
    const double e = double(p.albedo[3 * i + c]) - double(p.albedo[3 * j + c]);
    albedo += e * e, dot += n * m, nn += n * n, mm += m * m, alongI += n * d, alongJ += m * d;
  }
  const double turned = nn * mm > 0 ? 2 * std::max(1 - dot / std::sqrt(nn * mm), 0.0) : 0;
  const double width = double(std::max(p.footprint[i], p.footprint[j])) * std::sqrt(std::max(std::min(nn, mm), 1e-12));
  const double apart = width > 0 ? std::min(std::max(std::fabs(alongI), std::fabs(alongJ)) / width, 1e9) : 0;
  const double sigma = s.normal * std::numbers::pi / 180;
  return std::exp(-0.5 * (albedo / (s.albedo * s.albedo) + turned / (sigma * sigma) + apart * apart / (s.plane * s.plane)));
}
std::vector<double> bilateralReference(const SpatialPicture& p, const std::vector<float>& in, const BilateralSettings& s) {
  std::vector<double> out(in.size());
  for (int y = 0; y < p.height; ++y)
    for (int x = 0; x < p.width; ++x) {
      double weights = 0, sums[3] = {};
      for (int v = std::max(y - s.radius, 0); v <= std::min(y + s.radius, p.height - 1); ++v)
        for (int u = std::max(x - s.radius, 0); u <= std::min(x + s.radius, p.width - 1); ++u) {
          const double distance = (u - x) * (u - x) + (v - y) * (v - y), sigma = 0.5 * std::max(s.radius, 1);
          const double w = std::exp(-0.5 * distance / (sigma * sigma)) * alike(p, p.at(x, y), p.at(u, v), s);
          weights += w;
          for (size_t c = 0; c < 3; ++c) sums[c] += w * double(in[3 * p.at(u, v) + c]);
        }
      for (size_t c = 0; c < 3; ++c) out[3 * p.at(x, y) + c] = sums[c] / weights;
    }
  return out;
}

TEST(DenoiseJointBilateral, IsTheSumOfItsDefinition) {
  for (const BilateralSettings s :
       {BilateralSettings{}, BilateralSettings{3, 0.03, 4, 0.5}, BilateralSettings{1, 100, 180, 1000}, BilateralSettings{32, 1, 60, 20}}) {
    const SpatialPicture p = facets(s.radius > 8 ? 40 : 150, 41, 301);  // wider than a tile
    const Denoised out = denoised(*s.make(), p);
    const auto a = bilateralReference(p, p.a, s), b = bilateralReference(p, p.b, s);
    double worst = 0;
    for (size_t i = 0; i < a.size(); ++i)
      worst = std::max({worst, std::fabs(double(out.a[i]) - a[i]) / std::fabs(a[i]), std::fabs(double(out.b[i]) - b[i]) / std::fabs(b[i])});
    // With normals that cancel out a tap in a million has a plane a millionth of a pixel wide, whose distance is rounding: more of them at radius 32.
    EXPECT_LT(worst, s.radius > 8 ? 3e-5 : 1e-5) << s.radius;
    std::cout << "radius " << s.radius << ": worst relative error " << worst << std::endl;
  }
}

TEST(DenoiseJointBilateral, ChangesNothingWithRadiusZero) {
  const SpatialPicture p = facets(20, 10, 302);
  const Denoised out = denoised(*BilateralSettings{0}.make(), p);
  EXPECT_EQ(out.a, p.a);
  EXPECT_EQ(out.b, p.b);
}

TEST(DenoiseJointBilateral, StaysWithinTheRangeOfItsInput) {
  SpatialPicture p = facets(50, 30, 303);
  const Denoised out = denoised(*BilateralSettings{}.make(), p);
  const auto [low, high] = std::minmax_element(p.a.begin(), p.a.end());
  for (float v : out.a) ASSERT_TRUE(v >= *low * (1 - 1e-6f) && v <= *high * (1 + 1e-6f));
  p.light(1, 0, [](int, int, int c) { return 0.7f + float(c); });
  const Denoised constant = denoised(*BilateralSettings{}.make(), p);
  for (size_t i = 0; i < constant.a.size(); ++i) ASSERT_NEAR(constant.a[i] / p.a[i], 1, 1e-6);
}

TEST(DenoiseJointBilateral, PartsAndThreadsHaveTheSameBits) {
  const SpatialPicture p = facets(150, 40, 304);
  const auto filter = BilateralSettings{5}.make();
  ASSERT_EQ(filter->halo(), 5);
  const Denoised whole = denoised(*filter, p, 1);
  const Denoised threads = denoised(*filter, p, 4);
  EXPECT_EQ(threads.a, whole.a);
  EXPECT_EQ(threads.b, whole.b);
  for (const auto [x0, y0, x1, y1] : {std::array{10, 10, 140, 30}, std::array{0, 0, 20, 20}, std::array{131, 0, 150, 40}, std::array{3, 5, 30, 40}}) {
    const Denoised part = denoised(*filter, p.part(x0, y0, x1, y1));
    const int left = x0 ? 5 : 0, top = y0 ? 5 : 0, right = x1 < p.width ? 5 : 0, bottom = y1 < p.height ? 5 : 0;
    for (int y = y0 + top; y < y1 - bottom; ++y)
      for (int x = x0 + left; x < x1 - right; ++x)
        for (size_t c = 0; c < 3; ++c) ASSERT_EQ(part.a[3 * (size_t(y - y0) * size_t(x1 - x0) + size_t(x - x0)) + c], whole.a[3 * p.at(x, y) + c]);
  }
}

TEST(DenoiseJointBilateral, WithoutHalvesTheMeanIsFiltered) {
  SpatialPicture p = facets(40, 20, 305);
  p.halves = false;
  const Denoised out = denoised(*BilateralSettings{}.make(), p);
  const auto a = bilateralReference(p, p.mean, {});
  for (size_t i = 0; i < a.size(); ++i) ASSERT_NEAR(out.a[i] / a[i], 1, 1e-5);
}

TEST(DenoiseJointBilateral, HoldsForAnyFiniteInput) {
  for (const auto [w, h] : {std::array{1, 1}, std::array{3, 1}, std::array{1, 5}, std::array{33, 9}}) {
    SpatialPicture p = facets(w, h, 306);
    for (size_t i = 0; i < p.a.size(); ++i) {
      p.a[i] = (noise01(307, i) - 0.5f) * 2e18f;
      p.b[i] = noise01(308, i) < 0.5f ? 0.0f : 1e18f;
      p.position[i] = (noise01(309, i) - 0.5f) * 1e15f;
      p.variance[i] = 3e38f;
    }
    for (float& v : p.footprint) v = v > 0.01f ? 1e-30f : 1e15f;
    const Denoised out = denoised(*BilateralSettings{}.make(), p);
    for (size_t i = 0; i < p.a.size(); ++i) ASSERT_TRUE(std::isfinite(out.a[i]) && std::isfinite(out.b[i]) && std::fabs(out.a[i]) <= 1.001e18f);
  }
}

TEST(DenoiseJointBilateral, PixelsWithoutSurfaceMixWithTheirLikesOnly) {
  SpatialPicture p(40, 20);
  for (int y = 0; y < 20; ++y)
    for (int x = 0; x < 40; ++x) {
      if (x < 20) p.coverage[p.at(x, y)] = 0;
      for (size_t c = 0; c < 3; ++c) p.a[3 * p.at(x, y) + c] = x < 20 ? 5.0f : 1.0f;
    }
  const Denoised out = denoised(*BilateralSettings{}.make(), p);
  for (size_t i = 0; i < out.a.size(); ++i) ASSERT_NEAR(out.a[i], p.a[i], 1e-5);
}

}  // namespace

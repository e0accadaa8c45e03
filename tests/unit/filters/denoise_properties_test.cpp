// SPDX-License-Identifier: Apache-2.0
// What every denoiser promises (denoiser.h), over all that the schema lists: parts and threads have the same bits, nothing but finite numbers comes out,
// even light stays as it is, stops are noticed.
#include <gtest/gtest.h>

#include <cmath>

#include "denoise_spatial_pictures.h"
#include "filters/denoise/band_limit/lens_filter.h"
#include "filters/denoise/registry.h"

namespace gobo {
namespace denoise_properties_test {

using denoisespatial::Denoised;
using denoisespatial::denoised;
using denoisespatial::facets;
using denoisespatial::SpatialPicture;

/// Through a lens: by facets sharp, a little and much out of focus.
SpatialPicture blurred(SpatialPicture p) {
  p.blur.resize(p.pixels());
  for (int y = 0; y < p.height; ++y)
    for (int x = 0; x < p.width; ++x) p.blur[p.at(x, y)] = std::max(0.0f, 32 * denoisespatial::noise01(77, uint64_t(x / 11 + 50 * (y / 13))) - 8);
  return p;
}

/// Each filter of the schema's choice, small. (Defaults come with requests: here a field says what it is.)
std::vector<denoise::DenoiserPtr> all() {
  std::vector<denoise::DenoiserPtr> made;
  const auto* choice = v1::Denoise::descriptor()->FindOneofByName("filter");
  for (int i = 0; i < choice->field_count(); ++i) {
    v1::Denoise d;
    switch (choice->field(i)->number()) {
      case v1::Denoise::kAuto: continue;  // of several: plan/denoised.cpp
      case v1::Denoise::kJointBilateral: {
        auto& s = *d.mutable_joint_bilateral();
        s.set_radius_px(4), s.set_albedo(0.1), s.set_normal_deg(15), s.set_plane_px(2);
        break;
      }
      case v1::Denoise::kWavelet: {
        auto& s = *d.mutable_wavelet();
        s.set_levels(2), s.set_luminance(4), s.set_normal_power(64), s.set_plane_px(1);
        break;
      }
      case v1::Denoise::kNonLocalMeans: {
        auto& s = *d.mutable_non_local_means();
        s.set_radius_px(3), s.set_patch_px(2), s.set_damping(0.5), s.set_features(0.6);
        break;
      }
      case v1::Denoise::kFirstOrder: {
        auto& s = *d.mutable_first_order();
        s.set_radius_px(3), s.set_patch_px(1), s.set_damping(0.5);
        break;
      }
      case v1::Denoise::kAxisAligned: {
        auto& s = *d.mutable_axis_aligned();
        s.set_scale(1), s.set_radius_px(6), s.set_width_threshold(0.75), s.set_angle_deg(20);
        break;
      }
      default: ADD_FAILURE() << choice->field(i)->name() << " is not among the properties";
    }
    const auto one = denoise::makeDenoiser(d);
    EXPECT_TRUE(one.ok()) << one.status().toString();
    if (one.ok()) made.push_back(*one);
  }
  made.push_back(denoise::makeLensFilter(0.15f));  // in denoise.auto alone
  return made;
}

TEST(DenoiseProperties, HardlyAnyFeaturesAreStillNumbers) {
  for (const double features : {4.6240046725790314e-41, 1e-45, 1e-30, 1e-20, 1e-8, 1e-3}) {
    v1::Denoise d;
    auto& s = *d.mutable_non_local_means();
    s.set_radius_px(3), s.set_patch_px(2), s.set_damping(0.5), s.set_features(features);
    const auto filter = denoise::makeDenoiser(d);
    ASSERT_TRUE(filter.ok());
    const Denoised out = denoised(**filter, facets(23, 17, 4), 1);
    for (const float x : out.a) ASSERT_TRUE(std::isfinite(x)) << features;
    for (const float x : out.b) ASSERT_TRUE(std::isfinite(x)) << features;
  }
}

TEST(DenoiseProperties, PartsAndThreadsHaveTheSameBits) {
  for (const auto& filter : all())
    for (const bool halves : {true, false}) {
      SpatialPicture p = blurred(facets(83, 61, 4));
      p.halves = halves;
      const Denoised whole = denoised(*filter, p, 1), again = denoised(*filter, p, 3);
      EXPECT_EQ(whole.a, again.a) << filter->name();
      const int h = filter->halo();
      const int x0 = 31, y0 = 23, x1 = 47, y1 = 37;  // with the halo around it, as far as the picture goes
      const int left = std::max(x0 - h, 0), top = std::max(y0 - h, 0), right = std::min(x1 + h, p.width), bottom = std::min(y1 + h, p.height);
      const SpatialPicture part = p.part(left, top, right, bottom);
      const Denoised cut = denoised(*filter, part);
      for (int y = y0; y < y1; ++y)
        for (int x = x0; x < x1; ++x)
          for (size_t c = 0; c < 3; ++c) {
            ASSERT_EQ(cut.a[3 * part.at(x - left, y - top) + c], whole.a[3 * p.at(x, y) + c]) << filter->name() << " at " << x << ", " << y;
            if (halves) { ASSERT_EQ(cut.b[3 * part.at(x - left, y - top) + c], whole.b[3 * p.at(x, y) + c]) << filter->name(); }
          }
    }
}

TEST(DenoiseProperties, EvenLightStays) {
  for (const auto& filter : all()) {
    SpatialPicture p = blurred(facets(40, 30, 6));
    for (std::vector<float>* plane : {&p.mean, &p.a, &p.b}) std::fill(plane->begin(), plane->end(), 2.5f);
    for (const float variance : {0.0f, 0.04f}) {
      std::fill(p.variance.begin(), p.variance.end(), variance);
      const Denoised out = denoised(*filter, p);
      for (const std::vector<float>* plane : {&out.a, &out.b})
        for (const float v : *plane) ASSERT_NEAR(v, 2.5f, 2.5e-4f) << filter->name();
    }
  }
}

TEST(DenoiseProperties, FiniteForWhateverIsFinite) {
  for (const auto& filter : all())
    for (const auto& [width, height] : {std::pair{1, 1}, {3, 1}, {1, 4}, {17, 9}})
      for (const float huge : {1e18f, 1e-30f, 0.0f})
        for (const bool halves : {true, false})
          for (const float variance : {0.0f, 1e36f}) {
            SpatialPicture p = blurred(facets(width, height, 8));
            p.halves = halves;
            for (size_t i = 0; i < p.a.size(); i += 3) p.a[i] = p.mean[i] = huge, p.b[i] = -huge;
            std::fill(p.variance.begin(), p.variance.end(), variance);
            const Denoised out = denoised(*filter, p);
            for (size_t i = 0; i < out.a.size(); ++i) {
              ASSERT_TRUE(std::isfinite(out.a[i])) << filter->name();
              if (halves) { ASSERT_TRUE(std::isfinite(out.b[i])) << filter->name(); }
            }
          }
}

// Noise of 20 % on even light over one plane: each filter takes most of it.
TEST(DenoiseProperties, NoiseFalls) {
  for (const auto& filter : all()) {
    SpatialPicture p(60, 50);
    p.blur.assign(p.pixels(), 24.0f);
    p.light(21, 0.2f, [](int, int, int c) { return 1.0f + float(c); });
    const Denoised out = denoised(*filter, p);
    double own = 0, left = 0;
    for (size_t i = 0; i < p.a.size(); ++i) {
      const double truth = 1.0 + double(i % 3);
      own += (p.a[i] - truth) * (p.a[i] - truth);
      left += (out.a[i] - truth) * (out.a[i] - truth);
    }
    EXPECT_LT(left, 0.15 * own) << filter->name();
  }
}

TEST(DenoiseProperties, StopsWhenAsked) {
  for (const auto& filter : all()) {
    const SpatialPicture p = blurred(facets(64, 48, 2));
    StopSource stop;
    stop.stop(StopReason::Cancelled);
    std::vector<float> a(p.a.size()), b(p.a.size());
    EXPECT_FALSE(filter->run(p.view(), a, b, TaskArena(2), stop.token())) << filter->name();
  }
}

}  // namespace denoise_properties_test
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// The band limit of a lens: disks of confusion, means within them, features and light without noise.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "denoise_spatial_pictures.h"
#include "filters/denoise/band_limit/blurred_means.h"
#include "filters/denoise/band_limit/lens_blur.h"
#include "filters/denoise/band_limit/lens_features.h"
#include "filters/denoise/band_limit/lens_filter.h"
#include "filters/denoise/plane_set.h"
#include "noisy_pictures.h"
#include "synthetic.h"

namespace gobo {
namespace denoise_lens_test {

using denoisespatial::noise01;

Camera lensCamera(float radius, float focus, bool perspective = true) {
  Camera c;
  c.toWorld[3] = glm::vec4(1, 2, 3, 1);  // looks along -z
  c.perspective = perspective;
  c.optics.focal = 1.5;
  c.yheight = 4.0f;
  c.optics.lensRadius = radius;
  c.optics.focus = focus;
  return c;
}

/// A G-buffer of points at distances z along the axis, +inf: nothing; sample by sample.
TermPtr seenAt(int width, int height, int samples, const std::function<float(int x, int y, int s)>& z) {
  auto t = std::make_shared<Term>("gbuffer", Domain::ViewSample, Extent{width, height, samples});
  const auto place = t->addPlane<float>("P", 3), depth = t->addPlane<float>("depth");
  for (int s = 0; s < samples; ++s)
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const size_t i = (size_t(s) * size_t(height) + size_t(y)) * size_t(width) + size_t(x);
        const float d = z(x, y, s);
        depth[i] = d;
        if (std::isfinite(d)) place[3 * i] = 1.0f + 0.1f * float(x), place[3 * i + 1] = 2.0f, place[3 * i + 2] = 3.0f - d;
      }
  return t;
}

std::vector<float> blurOf(const Camera& camera, int pictureHeight, int width, int height, int samples, const std::function<float(int, int, int)>& z) {
  const auto out = test::runFilter(denoise::makeLensBlurNode(camera, pictureHeight, width, height, samples), {seenAt(width, height, samples, z)});
  const auto blur = out->floats("blur");
  return {blur.begin(), blur.end()};
}

constexpr float kNothing = std::numeric_limits<float>::infinity();

// The disk that docs/camera.md gives, whose traced truth is ThinLens.*: R |1/focus - 1/z| focal, focal = 1.5 x 200 pixels.
TEST(LensBlur, IsTheDiskOfConfusion) {
  for (const float z : {0.5f, 1.0f, 1.9f, 2.0f, 3.0f, 100.0f}) {
    const float expected = std::min(0.05f * 300.0f * std::fabs(1 / 2.0f - 1 / z), denoise::kMostBlur);
    for (const float r : blurOf(lensCamera(0.05f, 2), 200, 5, 4, 2, [&](int, int, int) { return z; })) EXPECT_NEAR(r, expected, 1e-5f + 1e-6f * expected) << z;
    const float telecentric = std::min(0.05f * 50.0f * std::fabs(1 - z / 2.0f), denoise::kMostBlur);
    for (const float r : blurOf(lensCamera(0.05f, 2, false), 200, 5, 4, 2, [&](int, int, int) { return z; })) EXPECT_NEAR(r, telecentric, 1e-5f) << z;
  }
  for (const float r : blurOf(lensCamera(0.05f, 2), 200, 5, 4, 1, [](int, int, int) { return kNothing; })) EXPECT_NEAR(r, 7.5f, 1e-5f);
  for (const float r : blurOf(lensCamera(0.05f, 2, false), 200, 5, 4, 1, [](int, int, int) { return kNothing; })) EXPECT_EQ(r, denoise::kMostBlur);
  // Wider pixels: fewer along a row.
  Camera wide = lensCamera(0.05f, 2);
  wide.optics.pixelAspect = 2.0f;
  for (const float r : blurOf(wide, 200, 5, 4, 1, [](int, int, int) { return kNothing; })) EXPECT_NEAR(r, 3.75f, 1e-5f);
}

TEST(LensBlur, OneSharpSampleIsEnoughAndSoIsOneNextToIt) {
  const auto blur = blurOf(lensCamera(0.05f, 2), 200, 9, 7, 4, [](int x, int y, int s) { return x == 4 && y == 3 && s == 2 ? 2.0f : kNothing; });
  for (int y = 0; y < 7; ++y)
    for (int x = 0; x < 9; ++x) EXPECT_NEAR(blur[size_t(9 * y + x)], std::abs(x - 4) <= 1 && std::abs(y - 3) <= 1 ? 0.0f : 7.5f, 1e-5f) << x << " " << y;
}

TEST(LensBlur, AtTheLensAndBehindItIsNoNumberLess) {
  for (const float z : {0.0f, -1.0f, 1e-30f, 1e30f})
    for (const bool perspective : {true, false})
      for (const float r : blurOf(lensCamera(0.05f, 2, perspective), 200, 3, 3, 1, [&](int, int, int) { return z; })) {
        ASSERT_TRUE(std::isfinite(r)) << z;
        ASSERT_LE(r, denoise::kMostBlur);
      }
}

std::vector<float> means(const std::vector<float>& blur, float share, int width, int height, const std::vector<float>& from, int threads = 1) {
  std::vector<float> to(from.size());
  const float* in[] = {from.data()};
  float* out[] = {to.data()};
  EXPECT_TRUE(denoise::bandLimitedMeans(blur, share, width, height, in, out, TaskArena(threads), {}));
  return to;
}

// Against the sum as it is written in the header, in double.
TEST(BandLimitedMeans, AreTheSumsOfTheHeader) {
  const int width = 37, height = 29;
  std::vector<float> blur, from;
  for (int i = 0; i < width * height; ++i) {
    blur.push_back(std::max(0.0f, 30 * noise01(3, uint64_t(i / 5)) - 6));
    from.push_back(noise01(4, uint64_t(i)));
  }
  for (const float share : {0.1f, 0.25f}) {
    const auto to = means(blur, share, width, height, from);
    EXPECT_EQ(to, means(blur, share, width, height, from, 3));
    for (int p = 0; p < width * height; ++p) {
      double sum = 0, weights = 0;
      for (int q = 0; q < width * height; ++q) {
        const double s = double(share) * std::min(blur[size_t(p)], blur[size_t(q)]);
        const double r2 = std::pow(p % width - q % width, 2) + std::pow(p / width - q / width, 2);
        if (p != q && (s == 0 || r2 > 6.25 * s * s * (1 + 1e-6))) continue;
        const double w = p == q ? 1.0 : std::exp(-r2 / (2 * s * s));
        sum += w * from[size_t(q)];
        weights += w;
      }
      ASSERT_NEAR(to[size_t(p)], sum / weights, 2e-3) << p;  // a tap on the rim may fall on either side
    }
  }
}

TEST(BandLimitedMeans, WhatIsSharpKeepsItsBitsAndGivesNothing) {
  const int width = 21, height = 15;
  std::vector<float> blur(size_t(width * height), 12.0f), from(size_t(width * height), 1.0f);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < 8; ++x) blur[size_t(y * width + x)] = 0.0f, from[size_t(y * width + x)] = 1000.0f + float(x * y);
  const auto to = means(blur, 0.25f, width, height, from);
  for (int i = 0; i < width * height; ++i) {
    if (i % width < 8) {
      ASSERT_EQ(to[size_t(i)], from[size_t(i)]);
    } else {
      ASSERT_NEAR(to[size_t(i)], 1.0f, 1e-6f);
    }
  }
}

/// What a lens sees of stripes a disk's width apart, in few view samples: each feature a mean over so many points of the disk.
struct Stripes {
  static constexpr int kWidth = 96, kHeight = 64, kSamples = 4;
  static constexpr float kBlur = 8;
  static double truth(int x) {  // the mean over a disk of a square wave of period 32, 0.2 and 0.8
    double sum = 0;
    int n = 0;
    for (int dy = -32; dy <= 32; ++dy)
      for (int dx = -32; dx <= 32; ++dx) {
        if (dx * dx + dy * dy > 32 * 32) continue;
        sum += int(std::floor((x + dx * kBlur / 32.0) / 16)) % 2 ? 0.8 : 0.2;
        ++n;
      }
    return sum / n;
  }
  static float seen(int x, int y, int channel) {
    double sum = 0;
    for (int s = 0; s < kSamples; ++s) {
      const uint64_t i = uint64_t((y * kWidth + x) * kSamples + s);
      const double r = kBlur * std::sqrt(double(noise01(91, i))), angle = 6.2831853 * double(noise01(92, i));
      sum += int(std::floor((x + 320 + r * std::cos(angle)) / 16)) % 2 ? 0.8 : 0.2;
    }
    (void)channel;
    return float(sum / kSamples);
  }
};

TEST(LensFeatures, AreNearerToTheTruthThanWhatFewSamplesSee) {
  auto features = tests::flatFeatures(Stripes::kWidth, Stripes::kHeight);
  const auto albedo = features->writable<float>("albedo"), modulation = features->writable<float>("modulation");
  const auto even = features->addPlane<float>("even");
  for (int p = 0; p < Stripes::kWidth * Stripes::kHeight; ++p)
    for (int c = 0; c < 3; ++c) {
      albedo[size_t(3 * p + c)] = Stripes::seen(p % Stripes::kWidth, p / Stripes::kWidth, c);
      modulation[size_t(3 * p + c)] = albedo[size_t(3 * p + c)] + 0.04f;
    }
  even[5] = 1.0f;
  auto blur = std::make_shared<Term>("lens_blur", Domain::Pixel, Extent{Stripes::kWidth, Stripes::kHeight, 1});
  for (float& b : blur->addPlane<float>("blur")) b = Stripes::kBlur;
  const auto out = test::runFilter(denoise::makeLensFeaturesNode(Stripes::kWidth, Stripes::kHeight, LobePart::Both), {features, blur});
  double before = 0, after = 0;
  for (int y = 10; y < Stripes::kHeight - 10; ++y)
    for (int x = 10; x < Stripes::kWidth - 10; ++x) {
      const size_t i = 3 * size_t(y * Stripes::kWidth + x);
      const double truth = Stripes::truth(x + 320);
      before += std::pow(albedo[i] - truth, 2);
      after += std::pow(out->floats("albedo")[i] - truth, 2);
      EXPECT_NEAR(out->floats("modulation")[i], out->floats("albedo")[i] + 0.04f, 1e-5f);
    }
  EXPECT_LT(after, 0.08 * before);  // a Gaussian of 2 pixels takes 49/50 of the noise and widens the stripes a little
  EXPECT_EQ(out->floats("even")[5], 1.0f);
  EXPECT_EQ(out->floats("even")[6], 0.0f);
  EXPECT_EQ(out->floats("blur")[7], Stripes::kBlur);
}

// Places, distances and sizes are of what is hit: what is not hit pulls them nowhere.
TEST(LensFeatures, WhatIsNotHitHasNoPlace) {
  const int n = 40;
  auto features = tests::flatFeatures(n, n);
  const auto coverage = features->writable<float>("coverage"), depth = features->writable<float>("depth"), position = features->writable<float>("position");
  for (float& e : features->addPlane<float>("even")) e = 0.0f;
  for (int p = 0; p < n * n; ++p) {
    coverage[size_t(p)] = float(p % 3) / 2;
    for (size_t c = 0; c < 3; ++c) position[size_t(3 * p) + c] = p % 3 ? 7.0f : 0.0f;
    if (p % 3 == 0) depth[size_t(p)] = 0.0f;
  }
  for (int p = 0; p < 10 * n; ++p) coverage[size_t(p)] = depth[size_t(p)] = 0.0f;
  auto blur = std::make_shared<Term>("lens_blur", Domain::Pixel, Extent{n, n, 1});
  for (float& b : blur->addPlane<float>("blur")) b = 8.0f;
  const auto out = test::runFilter(denoise::makeLensFeaturesNode(n, n, LobePart::Both), {features, blur});
  for (int p = 20 * n; p < n * n; ++p) {
    ASSERT_NEAR(out->floats("depth")[size_t(p)], 10.0f, 1e-4f);
    ASSERT_NEAR(out->floats("position")[size_t(3 * p)], 7.0f, 1e-4f);
  }
  for (int p = 0; p < 4 * n; ++p) ASSERT_EQ(out->floats("depth")[size_t(p)], 0.0f);
}

TEST(LensFilter, TakesNoiseFromWhatIsOutOfFocusAlone) {
  denoisespatial::SpatialPicture p(64, 48);
  p.light(5, 0.3f, [](int x, int, int) { return x < 32 ? 1.0f : 2.0f; });
  p.blur.assign(p.pixels(), 10.0f);
  for (int y = 0; y < 48; ++y)
    for (int x = 0; x < 32; ++x) p.blur[p.at(x, y)] = 0.0f;
  const auto out = denoisespatial::denoised(*denoise::makeLensFilter(0.3f), p);
  double before = 0, after = 0;
  for (int y = 0; y < 48; ++y)
    for (int x = 0; x < 64; ++x) {
      const size_t i = 3 * p.at(x, y);
      if (x < 32) {
        ASSERT_EQ(out.a[i], p.a[i]);
        ASSERT_EQ(out.b[i], p.b[i]);
      } else {
        before += std::pow(p.a[i] - 2, 2);
        after += std::pow(out.a[i] - 2, 2);
      }
    }
  EXPECT_LT(after, 0.03 * before);  // 1 / (4 pi 3^2), and what is left at borders
  p.blur.clear();
  EXPECT_EQ(denoisespatial::denoised(*denoise::makeLensFilter(0.3f), p).a, p.a);
}

}  // namespace denoise_lens_test
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Edge-avoiding wavelets against their definition in double, the noise that they leave, and the edges that they keep.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>

#include "filters/denoise/wavelet/wavelet.h"
#include "unit/filters/denoise_spatial_pictures.h"

namespace {

using namespace gobo;
using namespace gobo::denoisespatial;
using denoise::WaveletGuide;

struct WaveletSettings {
  int levels = 5;
  double luminance = 4, power = 64, plane = 1;
  WaveletGuide guide = WaveletGuide::Mean;
  denoise::DenoiserPtr make() const {
    v1::WaveletDenoise s;
    s.set_levels(uint32_t(levels));
    s.set_luminance(luminance);
    s.set_normal_power(power);
    s.set_plane_px(plane);
    return denoise::makeWavelet(s, guide);
  }
};

constexpr double kWaveletTaps[3] = {0.375, 0.25, 0.0625};
double waveletLuminance(const double* rgb) { return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]; }

/// Sum of the squares of the taps of all levels up to `level` as one filter in one dimension.
double cascadeSquares(int level) {
  std::vector<double> taps{1};
  for (int l = 0; l <= level; ++l) {
    std::vector<double> next(taps.size() + size_t(4 << l));
    for (size_t i = 0; i < taps.size(); ++i)
      for (int k = -2; k <= 2; ++k) next[i + size_t((k + 2) << l)] += taps[i] * kWaveletTaps[std::abs(k)];
    taps = next;
  }
  double sum = 0;
  for (double t : taps) sum += t * t;
  return sum;
}

struct WaveletReference {
  std::vector<double> light, guide, variance;
};
/// As the header says it; `in` filtered by weights of `guide`.
WaveletReference waveletReference(const SpatialPicture& p, const std::vector<float>& in, const std::vector<float>& guide, double share,
                                  const WaveletSettings& s) {
  const size_t n = p.coverage.size();
  WaveletReference r{{in.begin(), in.end()}, std::vector<double>(n), std::vector<double>(n)};
  std::vector<std::array<double, 3>> normals(n);
  for (size_t i = 0; i < n; ++i) {
    double rgb[3], deviation[3], length = 0;
    for (size_t c = 0; c < 3; ++c)
      rgb[c] = guide[3 * i + c], deviation[c] = std::sqrt(p.variance[3 * i + c]), length += double(p.normal[3 * i + c]) * p.normal[3 * i + c];
    r.guide[i] = waveletLuminance(rgb);
    r.variance[i] = waveletLuminance(deviation) * waveletLuminance(deviation) / share;
    for (size_t c = 0; c < 3; ++c) normals[i][c] = length > 0 ? p.normal[3 * i + c] / std::sqrt(length) : 0;
  }
  for (int level = 0; level < s.levels; ++level) {
    const double apart = cascadeSquares(0) * cascadeSquares(0), before = level ? std::pow(cascadeSquares(level - 1), 2) : 1;
    const double together = (std::pow(cascadeSquares(level), 2) / before - apart) / (1 - apart);
    WaveletReference next = r;
    for (int y = 0; y < p.height; ++y)
      for (int x = 0; x < p.width; ++x) {
        const size_t i = p.at(x, y);
        const bool hit = p.coverage[i] > 0;
        double blurred = 0, near = 0;
        for (int v = std::max(y - 1, 0); v <= std::min(y + 1, p.height - 1); ++v)
          for (int u = std::max(x - 1, 0); u <= std::min(x + 1, p.width - 1); ++u)
            if ((p.coverage[p.at(u, v)] > 0) == hit) {
              const double w = (u == x ? 0.5 : 0.25) * (v == y ? 0.5 : 0.25);
              blurred += w * r.variance[p.at(u, v)], near += w;
            }
        const double sigma = s.luminance * std::sqrt(blurred / near) + 1e-30;
        double weights = 0, light[3] = {}, sum = 0, mean = 0, squares = 0;
        for (int j = -2; j <= 2; ++j)
          for (int k = -2; k <= 2; ++k) {
            const int u = x + k * (1 << level), v = y + j * (1 << level);
            if (u < 0 || v < 0 || u >= p.width || v >= p.height) continue;
            const size_t q = p.at(u, v);
            double w = kWaveletTaps[std::abs(k)] * kWaveletTaps[std::abs(j)];
            if (q != i) {
              if ((p.coverage[q] > 0) != hit) continue;
              if (hit) {
                double cosine = 0, along = 0;
                for (size_t c = 0; c < 3; ++c) {
                  cosine += normals[i][c] * normals[q][c];
                  along += normals[i][c] * (double(p.position[3 * q + c]) - double(p.position[3 * i + c]));
                }
                w *= std::pow(std::clamp(cosine, 0.0, 1.0), s.power);
                if (p.footprint[i] > 0) w *= std::exp(-std::fabs(along) / (s.plane * double(p.footprint[i]) * (1 << level) * std::hypot(k, j)));
              }
              w *= std::exp(-std::fabs(r.guide[q] - r.guide[i]) / sigma);
            }
            for (size_t c = 0; c < 3; ++c) light[c] += w * r.light[3 * q + c];
            weights += w, sum += w * r.guide[q], mean += w * r.variance[q], squares += w * w * r.variance[q];
          }
        for (size_t c = 0; c < 3; ++c) next.light[3 * i + c] = light[c] / weights;
        next.guide[i] = sum / weights;
        next.variance[i] = (1 - together) * squares / (weights * weights) + together * mean / weights;
      }
    r = next;
  }
  return r;
}

TEST(DenoiseWavelet, IsTheSumOfItsDefinition) {
  for (const WaveletSettings s : {WaveletSettings{}, WaveletSettings{1, 1, 1, 0.1}, WaveletSettings{3, 20, 1024, 10}, WaveletSettings{7, 4, 37.5, 1}}) {
    const SpatialPicture p = facets(300, 23, 401);  // wider than a tile
    const Denoised out = denoised(*s.make(), p);
    const auto a = waveletReference(p, p.a, p.mean, 1, s), b = waveletReference(p, p.b, p.mean, 1, s);
    double worst = 0;
    for (size_t i = 0; i < p.a.size(); ++i)
      worst =
          std::max({worst, std::fabs(double(out.a[i]) - a.light[i]) / std::fabs(a.light[i]), std::fabs(double(out.b[i]) - b.light[i]) / std::fabs(b.light[i])});
    EXPECT_LT(worst, s.power > 100 ? 3e-4 : 3e-5) << s.levels;  // a cosine has an error of 1e-7 before the power
    std::cout << s.levels << " levels: worst relative error " << worst << std::endl;
  }
}

TEST(DenoiseWavelet, EachHalfByItsOwnGuide) {
  WaveletSettings s;
  s.guide = WaveletGuide::Own;
  const SpatialPicture p = facets(60, 23, 402);
  const Denoised out = denoised(*s.make(), p);
  const auto a = waveletReference(p, p.a, p.a, 0.5, s), b = waveletReference(p, p.b, p.b, 0.5, s);
  for (size_t i = 0; i < p.a.size(); ++i) {
    ASSERT_NEAR(out.a[i] / a.light[i], 1, 3e-5);
    ASSERT_NEAR(out.b[i] / b.light[i], 1, 3e-5);
  }
}

TEST(DenoiseWavelet, WithoutHalvesTheMeanIsFiltered) {
  SpatialPicture p = facets(60, 23, 403);
  p.halves = false;
  for (const WaveletGuide guide : {WaveletGuide::Mean, WaveletGuide::Own}) {
    WaveletSettings s;
    s.guide = guide;
    const Denoised out = denoised(*s.make(), p);
    const auto a = waveletReference(p, p.mean, p.mean, 1, s);
    for (size_t i = 0; i < p.a.size(); ++i) ASSERT_NEAR(out.a[i] / a.light[i], 1, 3e-5);
  }
}

TEST(DenoiseWavelet, StaysWithinTheRangeOfItsInput) {
  SpatialPicture p = facets(50, 40, 404);
  const Denoised out = denoised(*WaveletSettings{}.make(), p);
  const auto [low, high] = std::minmax_element(p.a.begin(), p.a.end());
  for (float v : out.a) ASSERT_TRUE(v >= *low * (1 - 2e-6f) && v <= *high * (1 + 2e-6f));
  p.light(1, 0, [](int, int, int c) { return 0.7f + float(c); });
  const Denoised constant = denoised(*WaveletSettings{}.make(), p);
  for (size_t i = 0; i < constant.a.size(); ++i) ASSERT_NEAR(constant.a[i] / p.a[i], 1, 2e-6);
}

/// Variance over many pictures at the middle of one, against the variance that the filter carries along.
TEST(DenoiseWavelet, NoiseFallsAsTheWeightsSay) {
  for (const double luminance : {100.0, 4.0})
    for (int levels = 1; levels <= 4; ++levels) {
      WaveletSettings s;
      s.levels = levels;
      s.luminance = luminance;
      const auto filter = s.make();
      const int side = 4 * filter->halo() / 2 + 24, from = filter->halo(), to = side - filter->halo();
      double squares = 0, predicted = 0, values = 0;
      for (uint64_t seed = 0; seed < (luminance == 100 ? 150u : 5u); ++seed) {  // the other one is only told
        SpatialPicture p(side, side);
        p.light(500 + seed, 0.2f, [](int, int, int) { return 1.0f; });
        const Denoised out = denoised(*filter, p);
        for (int y = from; y < to; ++y)
          for (int x = from; x < to; ++x) {
            const double v = 0.5 * (double(out.a[3 * p.at(x, y)]) + double(out.b[3 * p.at(x, y)])) - 1;
            squares += v * v, values += 1;
          }
        if (seed < 2) {
          const auto reference = waveletReference(p, p.mean, p.mean, 1, s);
          double sum = 0;
          for (int y = from; y < to; ++y)
            for (int x = from; x < to; ++x) sum += reference.variance[p.at(x, y)];
          predicted += sum / double((to - from) * (to - from)) / 2;
        }
      }
      const double measured = squares / values;
      std::cout << "luminance " << luminance << ", " << levels << " levels: variance " << measured << ", carried along " << predicted << std::endl;
      if (luminance == 100) { EXPECT_NEAR(measured / predicted, 1, 0.1) << levels; }
    }
}

TEST(DenoiseWavelet, KeepsEdges) {
  const auto check = [](const char* what, const SpatialPicture& p, double bound) {
    const Denoised out = denoised(*WaveletSettings{}.make(), p);
    double worst = 0;
    for (int y = 0; y < p.height; ++y)
      for (int x = 0; x < p.width; ++x) worst = std::max(worst, std::fabs(double(out.a[3 * p.at(x, y)]) / (x < 20 ? 1.0 : 2.0) - 1));
    EXPECT_LT(worst, bound) << what;
  };
  SpatialPicture step(40, 20);
  for (int y = 0; y < 20; ++y)
    for (int x = 20; x < 40; ++x)
      for (size_t c = 0; c < 3; ++c) step.a[3 * step.at(x, y) + c] = step.b[3 * step.at(x, y) + c] = step.mean[3 * step.at(x, y) + c] = 2;
  SpatialPicture loud = step;  // so much noise is said to be there that light does not tell the sides apart
  std::fill(loud.variance.begin(), loud.variance.end(), 1e6f);
  SpatialPicture p = loud;
  for (int y = 0; y < 20; ++y)
    for (int x = 20; x < 40; ++x) {
      p.normal[3 * p.at(x, y)] = 1;
      p.normal[3 * p.at(x, y) + 2] = 0;
    }
  check("normal", p, 1e-6);
  p = loud;
  for (int y = 0; y < 20; ++y)
    for (int x = 20; x < 40; ++x) p.position[3 * p.at(x, y) + 2] = 1e3f * 0.01f;  // 1000 pixel widths: 11 a pixel at the coarsest tap and more
  check("plane", p, 2e-6);
  p = loud;
  for (int y = 0; y < 20; ++y)
    for (int x = 20; x < 40; ++x) p.coverage[p.at(x, y)] = 0;
  check("coverage", p, 1e-6);
  p = step;
  check("light without noise", p, 1e-6);
  std::fill(p.variance.begin(), p.variance.end(), 0.01f);  // 10 standard deviations: exp(-2.5) at the first level, less at each after it
  const Denoised out = denoised(*WaveletSettings{}.make(), p);
  EXPECT_LT(out.a[3 * p.at(19, 10)], 1.1f);
  EXPECT_GT(out.a[3 * p.at(20, 10)], 1.9f);
  EXPECT_NEAR(out.a[3 * p.at(10, 10)], 1, 0.02);
  // None of them: the sides mix.
  EXPECT_GT(denoised(*WaveletSettings{}.make(), loud).a[3 * p.at(19, 10)], 1.4f);
}

TEST(DenoiseWavelet, PartsAndThreadsHaveTheSameBits) {
  SpatialPicture p = facets(310, 60, 405);
  p.light(406, 0.5f, [](int x, int y, int) { return 1 + float(x) / 100 + float(y) / 100; });
  for (const int levels : {1, 3, 4}) {
    WaveletSettings s;
    s.levels = levels;
    const auto filter = s.make();
    const int halo = filter->halo();
    ASSERT_EQ(halo, 2 * ((1 << levels) - 1));
    const Denoised whole = denoised(*filter, p, 1), threads = denoised(*filter, p, 4);
    EXPECT_EQ(threads.a, whole.a);
    EXPECT_EQ(threads.b, whole.b);
    for (const auto [x0, y0, x1, y1] : {std::array{10, 0, 300, 60}, std::array{0, 0, 50, 45}, std::array{259, 7, 310, 60}, std::array{1, 1, 309, 59}}) {
      const Denoised part = denoised(*filter, p.part(x0, y0, x1, y1));
      const int left = x0 ? halo : 0, top = y0 ? halo : 0, right = x1 < p.width ? halo : 0, bottom = y1 < p.height ? halo : 0;
      for (int y = y0 + top; y < y1 - bottom; ++y)
        for (int x = x0 + left; x < x1 - right; ++x)
          for (size_t c = 0; c < 3; ++c) {
            const size_t i = 3 * (size_t(y - y0) * size_t(x1 - x0) + size_t(x - x0)) + c;
            ASSERT_EQ(part.a[i], whole.a[3 * p.at(x, y) + c]);
            ASSERT_EQ(part.b[i], whole.b[3 * p.at(x, y) + c]);
          }
    }
  }
}

TEST(DenoiseWavelet, HoldsForAnyFiniteInput) {
  for (const WaveletGuide guide : {WaveletGuide::Mean, WaveletGuide::Own})
    for (const auto [w, h] : {std::array{1, 1}, std::array{3, 1}, std::array{1, 5}, std::array{257, 9}}) {
      SpatialPicture p = facets(w, h, 407);
      for (size_t i = 0; i < p.a.size(); ++i) {
        p.a[i] = (noise01(408, i) - 0.5f) * 2e18f;
        p.b[i] = noise01(409, i) < 0.5f ? 0.0f : 1e18f;
        p.mean[i] = 0.5f * p.a[i] + 0.5f * p.b[i];
        p.position[i] = (noise01(410, i) - 0.5f) * 1e15f;
        p.variance[i] = noise01(411, i) < 0.5f ? 0.0f : 3e38f;
      }
      for (float& v : p.footprint) v = v > 0.01f ? 1e-38f : 1e15f;
      WaveletSettings s;
      s.guide = guide;
      s.levels = 7;
      const Denoised out = denoised(*s.make(), p);
      for (size_t i = 0; i < p.a.size(); ++i)
        ASSERT_TRUE(std::isfinite(out.a[i]) && std::isfinite(out.b[i]) && std::fabs(out.a[i]) <= 1.001e18f) << out.a[i] << " " << out.b[i];
    }
}

TEST(DenoiseWavelet, StopsWhenAsked) {
  StopSource source;
  source.stop(StopReason::Cancelled);
  const SpatialPicture p = facets(20, 20, 412);
  std::vector<float> a(p.a.size()), b(p.a.size());
  EXPECT_FALSE(WaveletSettings{}.make()->run(p.view(), a, b, TaskArena(2), source.token()));
}

}  // namespace

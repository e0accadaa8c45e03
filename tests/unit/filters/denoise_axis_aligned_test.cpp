// SPDX-License-Identifier: Apache-2.0
// Axis-aligned filtering of indirect light: means along lines against their formula in double, the law of their noise, widths of least predicted error.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "denoise_spatial_pictures.h"
#include "filters/denoise/axis_aligned/axis_aligned.h"
#include "filters/denoise/axis_aligned/line_means.h"
#include "formulas/axis_aligned_indirect.glsl.h"
#include "formulas/formulas.h"

namespace gobo {
namespace denoise_axis_aligned_test {

using denoise::AlikeFeatures;
using denoise::AlikePlanes;
using denoise::LineWindow;
using denoisespatial::Denoised;
using denoisespatial::denoised;
using denoisespatial::facets;
using denoisespatial::noise01;
using denoisespatial::SpatialPicture;

denoise::DenoiserPtr filter(double scale = 1, int radius = 48, double threshold = 0.75) {
  v1::AxisAlignedDenoise s;
  s.set_scale(scale), s.set_radius_px(uint32_t(radius)), s.set_width_threshold(threshold), s.set_angle_deg(20);
  return denoise::makeAxisAligned(s);
}

AlikeFeatures featuresOf(const SpatialPicture& p) {
  AlikeFeatures f;
  const TaskArena arena(2);
  EXPECT_TRUE(f.fill({p.albedo, p.normal, p.position, p.depth, p.footprint, p.coverage}, p.width, p.height, arena, StopToken()));
  return f;
}

TEST(DenoiseAxisAligned, LineMeansAreThoseOfTheFormula) {
  const SpatialPicture p = facets(150, 23, 3);
  const AlikeFeatures features = featuresOf(p);
  const AlikePlanes& k = features.planes();
  std::vector<float> width(p.coverage.size()), in[2], out[2];
  for (size_t i = 0; i < width.size(); ++i) width[i] = noise01(9, i) < 0.2f ? 0.0f : noise01(10, i) < 0.2f ? -1.0f : 0.5f + 6 * noise01(11, i / 40);
  for (size_t c = 0; c < 2; ++c) {
    out[c].resize(width.size());
    for (size_t i = 0; i < width.size(); ++i) in[c].push_back(noise01(20 + c, i));
  }
  const LineWindow window{width.data(), 9, 0.9f, 0.6f};
  const float* from[2] = {in[0].data(), in[1].data()};
  float* to[2] = {out[0].data(), out[1].data()};
  int changed = 0;
  for (const bool columns : {false, true}) {
    for (int y = 0; y < p.height; ++y) denoise::lineMeansRow(k, window, columns, from, 2, y, to);
    for (int y = 0; y < p.height; ++y)
      for (int x = 0; x < p.width; ++x) {
        const size_t i = p.at(x, y);
        double sum[2] = {in[0][i], in[1][i]}, weights = 1;
        const double beta = width[i], metres = beta * k.footprint[i];
        const int reach = beta > 0 && metres > 0 ? std::min(int(std::ceil(2.5 * beta)), 9) : 0;
        for (int d = -reach; d <= reach; ++d) {
          const int u = columns ? x : x + d, v = columns ? y + d : y;
          if (d == 0 || u < 0 || v < 0 || u >= p.width || v >= p.height) continue;
          const size_t q = p.at(u, v);
          double along = 0, square = 0, cosine = 0;
          for (int c = 0; c < 3; ++c) {
            const double way = double(k.place[c][q]) - k.place[c][i];
            along += way * k.unit[c][i];
            square += way * way;
            cosine += double(k.unit[c][q]) * k.unit[c][i];
          }
          if (width[q] < 0 || cosine < 0.9 || std::abs(along) > 2 * std::max(1.0, 0.25 * std::abs(d)) * k.footprint[i] ||
              std::abs(double(width[q]) - beta) > 0.6 * std::max(double(width[q]), beta))
            continue;
          const double w = std::exp(-(square - along * along) / (2 * metres * metres));
          for (int c = 0; c < 2; ++c) sum[c] += w * in[c][q];
          weights += w;
        }
        changed += weights > 1.01;
        for (int c = 0; c < 2; ++c) ASSERT_NEAR(out[c][i], sum[c] / weights, 2e-5) << x << ", " << y << (columns ? " columns" : " rows");
      }
  }
  EXPECT_GT(changed, 500);
}

// Var_out / Var_in = 1 / (4 pi beta^2), beta in pixels.
TEST(DenoiseAxisAligned, NoiseFallsByTheLaw) {
  const int w = 400, h = 300;
  const SpatialPicture p(w, h);
  const AlikeFeatures features = featuresOf(p);
  for (const float beta : {1.5f, 3.0f, 6.0f, 12.0f}) {
    std::vector<float> width(p.coverage.size(), beta), in(width.size()), rows(width.size()), out(width.size());
    for (size_t i = 0; i < in.size(); ++i) in[i] = noise01(5, i) - 0.5f;
    const LineWindow window{width.data(), 48, 0.9f, 0.6f};
    const float *a = in.data(), *b = rows.data();
    float *toRows = rows.data(), *to = out.data();
    for (int y = 0; y < h; ++y) denoise::lineMeansRow(features.planes(), window, false, &a, 1, y, &toRows);
    for (int y = 0; y < h; ++y) denoise::lineMeansRow(features.planes(), window, true, &b, 1, y, &to);
    double sum = 0;
    int n = 0;
    for (int y = 40; y < h - 40; ++y)
      for (int x = 40; x < w - 40; ++x, ++n) sum += double(out[p.at(x, y)]) * out[p.at(x, y)];
    const double expected = 1.0 / 12 / (4 * std::numbers::pi * beta * beta);
    // Cut at 2.5 widths a little more is left; of a hundred independent places at the widest the variance is known to some 10 %.
    EXPECT_NEAR(sum / n, expected, (0.05 + 0.012 * beta) * expected) << beta;
  }
}

TEST(DenoiseAxisAligned, PredictedWidthIsTheLeastError) {
  using formulas::aaIndirectPredictedWidth;
  for (const double v : {1e-8, 1e-3, 0.2, 50.0})
    for (const double c : {1e-6, 1e-3, 0.5}) {
      const auto error = [&](double w) { return std::pow(0.2 * w * w * c, 2) + v / (4 * std::numbers::pi * w * w); };
      const double w = aaIndirectPredictedWidth(float(v), float(c));
      EXPECT_NEAR(w, std::pow(v / (8 * std::numbers::pi * 0.04 * c * c), 1.0 / 6), 1e-5 * w);
      EXPECT_LT(error(w), error(0.99 * w));
      EXPECT_LT(error(w), error(1.01 * w));
    }
  EXPECT_EQ(aaIndirectPredictedWidth(0.0f, 1.0f), 0.0f);
  EXPECT_EQ(aaIndirectPredictedWidth(-1.0f, 1.0f), 0.0f);
  EXPECT_EQ(aaIndirectPredictedWidth(1.0f, 0.0f), 1e4f);
  for (const float v : {1e-38f, 1.0f, 3e38f})
    for (const float c : {0.0f, 1e-38f, 1.0f, 1e30f}) {
      const float w = aaIndirectPredictedWidth(v, c);
      EXPECT_TRUE(w >= 0.0f && w <= 1e4f) << v << " " << c << " " << w;
    }
}

TEST(DenoiseAxisAligned, LobesBendAsWhatTheyShowTurns) {
  using formulas::aaSpecularCurvature;
  EXPECT_NEAR(aaSpecularCurvature(0.04f, 1.0f, 0.0f, 0.2925f), 0.04f, 1e-6f);  // as wide as a radian: that of the light
  EXPECT_NEAR(aaSpecularCurvature(0.04f, 4.0f, 0.1f, 0.2925f), 0.16f, 1e-6f);  // (0.2 + 2 x 0.1)^2
  EXPECT_GT(aaSpecularCurvature(0.04f, 1.0f, 0.0f, 0.0f), 200 * 0.04f);        // mirrors
  for (const float c : {0.0f, 1e30f, -1.0f})
    for (const float l : {0.0f, 3e38f, -1.0f})
      for (const float turning : {0.0f, 3.0f, 1e18f}) {
        const float v = aaSpecularCurvature(c, l, turning, 0.0f);
        EXPECT_TRUE(v >= 0.0f && v <= 1e30f) << c << " " << l << " " << turning;
      }
}

double scatter(const SpatialPicture& p, const std::vector<float>& v, int x0, int x1) {
  double sum = 0, square = 0;
  int n = 0;
  for (int y = 30; y < p.height - 30; ++y)
    for (int x = x0; x < x1; ++x, ++n) {
      sum += v[3 * p.at(x, y)];
      square += double(v[3 * p.at(x, y)]) * v[3 * p.at(x, y)];
    }
  return std::sqrt(std::max(square / n - sum / n * (sum / n), 0.0));
}

// Where light bends much the filter is narrow, and where noise is strong wide.
TEST(DenoiseAxisAligned, WidthsFollowBendingAndNoise) {
  SpatialPicture p(160, 100);
  p.light(4, 0.3f, [](int, int, int) { return 1.0f; });
  for (int y = 0; y < p.height; ++y)
    for (int x = 0; x < p.width; ++x) p.curvature[p.at(x, y)] = x < 80 ? 2e-4f : 0.5f;
  const Denoised out = denoised(*filter(), p);
  EXPECT_LT(scatter(p, out.a, 30, 50), 0.12 * scatter(p, p.a, 30, 50));
  EXPECT_GT(scatter(p, out.a, 110, 130), 0.3 * scatter(p, p.a, 110, 130));
  SpatialPicture noisier = p;
  for (float& v : noisier.variance) v *= 100;
  EXPECT_LT(scatter(p, denoised(*filter(), noisier).a, 110, 130), 0.7 * scatter(p, out.a, 110, 130));
  EXPECT_LT(scatter(p, denoised(*filter(2), p).a, 110, 130), 0.8 * scatter(p, out.a, 110, 130));
  // Without noise, of no radius, and where nobody says how it bends it stays as it is.
  SpatialPicture calm = p;
  std::fill(calm.variance.begin(), calm.variance.end(), 0.0f);
  EXPECT_EQ(denoised(*filter(), calm).a, p.a);
  EXPECT_EQ(denoised(*filter(1, 0), p).a, p.a);
  SpatialPicture unknown = p;
  unknown.curvature.clear();
  EXPECT_EQ(denoised(*filter(), unknown).a, p.a);
}

// A width far below a pixel would take from the next one what rounding leaves of it: it is none.
TEST(DenoiseAxisAligned, WidthsFarBelowAPixelChangeNothing) {
  SpatialPicture p(40, 30);
  p.light(7, 0.02f, [](int, int, int) { return 1.0f; });
  const float bending = 0.5f;
  std::fill(p.curvature.begin(), p.curvature.end(), bending);
  for (const bool narrow : {true, false}) {
    const double width = narrow ? 0.29 : 0.31;
    std::fill(p.variance.begin(), p.variance.end(), float(std::pow(width, 6) * 8 * std::numbers::pi * 0.04 * double(bending * bending)));
    EXPECT_EQ(denoised(*filter(), p).a == p.a, narrow) << width;
  }
}

// Pixels that surfaces share are nobody's neighbours, and stay for others to mend.
TEST(DenoiseAxisAligned, LeavesOutWhatIsNotEven) {
  SpatialPicture p(90, 90);
  p.light(5, 0.2f, [](int, int, int) { return 1.0f; });
  std::fill(p.curvature.begin(), p.curvature.end(), 1e-4f);
  for (int y = 0; y < p.height; ++y) {
    p.even[p.at(45, y)] = 0;
    p.a[3 * p.at(45, y)] = p.b[3 * p.at(45, y)] = 1e6f;
  }
  const Denoised out = denoised(*filter(), p);
  for (int y = 0; y < p.height; ++y)
    for (int x = 0; x < p.width; ++x) {
      const float v = out.a[3 * p.at(x, y)];
      EXPECT_NEAR(v, x == 45 ? 1e6f : 1.0f, x == 45 ? 0.0f : 0.5f) << x << ", " << y;
    }
}

// A mirror that bends shows every pixel something else; a broad lobe on a plane hardly.
TEST(DenoiseAxisAligned, NarrowLobesAreFilteredNarrowly) {
  SpatialPicture p(120, 100);
  p.light(6, 0.3f, [](int, int, int) { return 1.0f; });
  std::fill(p.curvature.begin(), p.curvature.end(), 1e-4f);
  p.alpha.assign(p.coverage.size(), 1.0f);
  const double broad = scatter(p, denoised(*filter(), p).a, 40, 80);
  std::fill(p.alpha.begin(), p.alpha.end(), 0.0f);
  const double narrow = scatter(p, denoised(*filter(), p).a, 40, 80);
  EXPECT_GT(narrow, 1.5 * broad);
  for (int y = 0; y < p.height; ++y)
    for (int x = 0; x < p.width; ++x) {  // a cylinder of 1 m, seen from 1 m
      const float turn = 0.01f * float(x - 60);
      p.normal[3 * p.at(x, y)] = std::sin(turn);
      p.normal[3 * p.at(x, y) + 2] = std::cos(turn);
    }
  EXPECT_GT(scatter(p, denoised(*filter(), p).a, 40, 80), 1.2 * narrow);
}

}  // namespace denoise_axis_aligned_test
}  // namespace gobo

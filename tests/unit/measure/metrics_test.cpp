// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "measure/display.h"
#include "measure/metrics.h"
#include "measure/perceptual.h"
#include "support/certificate_cases.h"

namespace gobo {
namespace {

using gobo::testing::Stream;

Image constant(int w, int h, const Vec3& c) {
  Image out(w, h, 3);
  for (size_t i = 0; i < out.pixels(); ++i)
    for (int k = 0; k < 3; ++k) out.data[i * 3 + k] = c[k];
  return out;
}
Image textured(int w, int h) {
  Image out(w, h, 3);
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
      for (int c = 0; c < 3; ++c) out.at(x, y)[c] = float(0.5 + 0.3 * std::sin(0.7 * x + c) * std::cos(0.4 * y) + ((x / 5 + y / 5) % 2 ? 0.1 : 0));
  return out;
}

TEST(Metrics, HandComputedFigures) {
  Image a(2, 2, 3), b(2, 2, 3);
  // differences: pixel 0 {0.3, 0, 0}, pixel 3 {0, -0.1, 0.2}
  for (float& v : b.data) v = 0.5f;
  a.data = b.data;
  a.data[0] += 0.3f;
  a.data[10] -= 0.1f;
  a.data[11] += 0.2f;
  const auto r = compareImages(a, b);
  ASSERT_TRUE(r.ok());
  EXPECT_NEAR(r->rmse, std::sqrt((0.09 + 0.01 + 0.04) / 12), 1e-7);
  EXPECT_NEAR(r->relMse, (0.09 + 0.01 + 0.04) / 12 / 0.26, 1e-7);
  EXPECT_NEAR(r->meanAbs, 0.6 / 12, 1e-7);
  EXPECT_NEAR(r->p99, 0.1, 1e-7);
  EXPECT_NEAR(r->maxAbs, 0.3, 1e-7);
  EXPECT_NEAR(r->meanB, 0.5, 1e-7);
  EXPECT_NEAR(r->meanA, 0.5 + (0.2126 * 0.3 - 0.7152 * 0.1 + 0.0722 * 0.2) / 4, 1e-7);
  EXPECT_EQ(r->differingPixels, 2u);
  EXPECT_EQ(r->nonFinite, 0u);
}

TEST(Metrics, PercentileIsNearestRank) {
  Image a(200, 1, 1), b(200, 1, 1);
  for (int i = 0; i < 200; ++i) a.data[size_t(i)] = float(199 - i);
  EXPECT_EQ(compareImages(a, b)->p99, 197);  // rank ceil(0.99 * 200) = 198 of 0..199
}

TEST(Metrics, NonFinitePixelsAreCountedAndLeftOut) {
  Image a = constant(4, 4, Vec3(0.5f)), b = constant(4, 4, Vec3(0.25f));
  a.data[4] = std::numeric_limits<float>::quiet_NaN();
  b.data[20] = std::numeric_limits<float>::infinity();
  const auto r = compareImages(a, b);
  EXPECT_EQ(r->nonFinite, 2u);
  EXPECT_EQ(r->nonFiniteApart, 2u);
  EXPECT_NEAR(r->rmse, 0.25, 1e-9);
  EXPECT_TRUE(std::isfinite(r->ssim));
  EXPECT_TRUE(std::isfinite(r->flip));
  EXPECT_EQ(compareImages(a, a)->nonFiniteApart, 0u);
  EXPECT_EQ(compareImages(a, a)->differingPixels, 0u) << "bitwise: the same NaN does not differ";
  EXPECT_EQ(errorAgainstHalves(a, b, b)->nonFinite, 2u);
  EXPECT_NEAR(errorAgainstHalves(a, b, b)->rmse, 0.25, 1e-9);
}

TEST(Metrics, DifferentSizesAreRefused) {
  EXPECT_EQ(compareImages(Image(3, 2, 3), Image(2, 3, 3)).status().code(), Code::InvalidArgument);
  EXPECT_EQ(compareImages(Image(), Image()).status().code(), Code::InvalidArgument);
  EXPECT_EQ(errorAgainstHalves(Image(3, 2, 3), Image(3, 2, 3), Image(2, 2, 3)).status().code(), Code::InvalidArgument);
  EXPECT_EQ(compareImages(Image(3, 2, 3), Image(3, 2, 3), std::vector<uint8_t>(5)).status().code(), Code::InvalidArgument);
}

TEST(Metrics, PenumbraMaskSelectsTheBand) {
  Image truth(40, 9, 1), picture(40, 9, 1);
  for (int y = 0; y < 9; ++y)
    for (int x = 0; x < 40; ++x) {
      truth.at(x, y)[0] = x < 18 ? 0.0f : x > 21 ? 1.0f : 0.2f * float(x - 17);
      picture.at(x, y)[0] = truth.at(x, y)[0] + (x >= 18 && x <= 21 ? 0.1f : 0.0f);
    }
  const auto mask = penumbraMask(truth);
  for (int x = 0; x < 40; ++x) EXPECT_EQ(mask[size_t(4 * 40 + x)], x >= 16 && x <= 23) << x;
  EXPECT_NEAR(compareImages(picture, truth, mask)->rmse, 0.1 * std::sqrt(0.5), 1e-6);
  EXPECT_NEAR(compareImages(picture, truth)->rmse, 0.1 * std::sqrt(0.1), 1e-6);
  EXPECT_EQ(compareImages(picture, truth, std::vector<uint8_t>(360, 0))->rmse, 0);
}

TEST(Ssim, IdenticalIsOneAndConstantsFollowTheFormula) {
  const Image t = textured(40, 30);
  EXPECT_NEAR(structuralSimilarity(t, t), 1, 1e-12);
  // Two constants: only the luminance factor is left.
  const double p = srgbEncode(0.2), q = srgbEncode(0.6), c1 = 1e-4;
  const double expected = (2 * p * q + c1) / (p * p + q * q + c1);
  EXPECT_NEAR(structuralSimilarity(constant(20, 20, Vec3(0.2f)), constant(20, 20, Vec3(0.6f))), expected, 1e-6);
  EXPECT_NEAR(structuralSimilarity(constant(5, 4, Vec3(0.2f)), constant(5, 4, Vec3(0.6f))), expected, 1e-6);
}

/// One window (an 11 x 11 picture) against the definition evaluated with the 2D Gaussian and centred moments.
TEST(Ssim, OneWindowMatchesTheDefinition) {
  Image a = textured(11, 11), b = a;
  Stream random(3);
  for (float& v : b.data) v = float(v + 0.1 * random.normal());
  double sum = 0, ma = 0, mb = 0, va = 0, vb = 0, cov = 0;
  const auto weight = [](int x, int y) { return std::exp(-((x - 5) * (x - 5) + (y - 5) * (y - 5)) / 4.5); };
  for (int y = 0; y < 11; ++y)
    for (int x = 0; x < 11; ++x) {
      sum += weight(x, y);
      ma += weight(x, y) * displayLuma(a.rgb(x, y));
      mb += weight(x, y) * displayLuma(b.rgb(x, y));
    }
  ma /= sum, mb /= sum;
  for (int y = 0; y < 11; ++y)
    for (int x = 0; x < 11; ++x) {
      const double da = displayLuma(a.rgb(x, y)) - ma, db = displayLuma(b.rgb(x, y)) - mb, w = weight(x, y) / sum;
      va += w * da * da, vb += w * db * db, cov += w * da * db;
    }
  const double expected = (2 * ma * mb + 1e-4) * (2 * cov + 9e-4) / ((ma * ma + mb * mb + 1e-4) * (va + vb + 9e-4));
  EXPECT_NEAR(structuralSimilarity(a, b), expected, 1e-9);
  EXPECT_LT(expected, 0.95);
}

double meanFlip(const Image& a, const Image& b) {
  double sum = 0;
  for (double f : flipMap(a, b, flipPixelsPerDegree())) sum += f;
  return sum / double(a.pixels());
}

/// On constant pictures every filter vanishes: FLIP is the redistributed HyAB distance of two colours.
TEST(Flip, ConstantsFollowTheColourFormula) {
  EXPECT_NEAR(flipPixelsPerDegree(), 67.0206, 1e-3);
  const Image t = textured(40, 30);
  EXPECT_EQ(meanFlip(t, t), 0);
  // Greys have no chroma: HyAB = |dL|. The largest distance is Hunt-adjusted green to blue: CIELAB (D65) of sRGB green is
  // (87.735, -86.183, 83.180) and of blue (32.299, 79.191, -107.858) (published values of either), with a and b times 0.01 L.
  const double da = -86.183 * 0.87735 - 79.191 * 0.32299, db = 83.180 * 0.87735 + 107.858 * 0.32299;
  const double largest = std::pow(87.735 - 32.299 + std::hypot(da, db), 0.7), knee = 0.4 * largest;
  const auto lightness = [](double y) { return 116 * std::cbrt(y) - 16; };
  const auto expected = [&](double y1, double y2) {
    const double powered = std::pow(std::fabs(lightness(y1) - lightness(y2)), 0.7);
    return powered < knee ? 0.95 / knee * powered : 0.95 + (powered - knee) / (largest - knee) * 0.05;
  };
  EXPECT_NEAR(meanFlip(constant(30, 30, Vec3(0.2f)), constant(30, 30, Vec3(0.5f))), expected(0.2, 0.5), 1e-4);
  EXPECT_NEAR(meanFlip(constant(30, 30, Vec3(0.02f)), constant(30, 30, Vec3(1.0f))), expected(0.02, 1.0), 1e-4);
  EXPECT_NEAR(meanFlip(constant(30, 30, Vec3(0, 1, 0)), constant(30, 30, Vec3(0, 0, 1))), 1, 1e-9);
}

/// A small red-to-black step: the whole pipeline against the 2D formulas of the paper evaluated directly at one pixel.
TEST(Flip, StepMatchesDirect2dFilters) {
  const int w = 48, h = 40, px = 23, py = 17;
  Image a(w, h, 3), b(w, h, 3);
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      const Vec3 ca = x < 24 ? Vec3(0.7f, 0.3f, 0.1f) : Vec3(0.2f, 0.3f, 0.6f), cb = x + y / 4 < 29 ? Vec3(0.6f, 0.35f, 0.1f) : Vec3(0.25f, 0.25f, 0.5f);
      for (int c = 0; c < 3; ++c) a.at(x, y)[c] = ca[c], b.at(x, y)[c] = cb[c];
    }
  const double ppd = flipPixelsPerDegree(), pi = std::acos(-1.0);
  // The standard sRGB matrices to seven digits, an independent source of the transform.
  const double m[3][3] = {{0.4124564, 0.3575761, 0.1804375}, {0.2126729, 0.7151522, 0.0721750}, {0.0193339, 0.1191920, 0.9503041}};
  const double inv[3][3] = {{3.2404542, -1.5371385, -0.4985314}, {-0.9692660, 1.8760108, 0.0415560}, {0.0556434, -0.2040259, 1.0572252}};
  const double white[3] = {0.95047, 1.0, 1.08883};
  const auto opponent = [&](const Image& image, int x, int y, double out[3]) {
    const Vec3 c = image.rgb(std::clamp(x, 0, w - 1), std::clamp(y, 0, h - 1));
    double r[3];
    for (int i = 0; i < 3; ++i) r[i] = (m[i][0] * c.x + m[i][1] * c.y + m[i][2] * c.z) / white[i];
    out[0] = 116 * r[1] - 16, out[1] = 500 * (r[0] - r[1]), out[2] = 200 * (r[1] - r[2]);
  };
  struct Local {
    double lab[3], edge, point;
  };
  const auto local = [&](const Image& image) {
    Local out{};
    double sums[3] = {}, weights[3] = {}, o[3];
    for (int j = -10; j <= 10; ++j)
      for (int i = -10; i <= 10; ++i) {
        const double z = (i * i + j * j) / (ppd * ppd);
        const double s[3] = {std::sqrt(pi / 0.0047) * std::exp(-pi * pi * z / 0.0047), std::sqrt(pi / 0.0053) * std::exp(-pi * pi * z / 0.0053),
                             34.1 * std::sqrt(pi / 0.04) * std::exp(-pi * pi * z / 0.04) + 13.5 * std::sqrt(pi / 0.025) * std::exp(-pi * pi * z / 0.025)};
        opponent(image, px + i, py + j, o);
        for (int c = 0; c < 3; ++c) sums[c] += s[c] * o[c], weights[c] += s[c];
      }
    double f[3], xyz[3], rgb[3], t[3];
    for (int c = 0; c < 3; ++c) f[c] = sums[c] / weights[c];
    const double yy = (f[0] + 16) / 116;
    xyz[0] = (yy + f[1] / 500) * white[0], xyz[1] = yy, xyz[2] = (yy - f[2] / 200) * white[2];
    for (int i = 0; i < 3; ++i) rgb[i] = std::clamp(inv[i][0] * xyz[0] + inv[i][1] * xyz[1] + inv[i][2] * xyz[2], 0.0, 1.0);
    for (int i = 0; i < 3; ++i) t[i] = std::cbrt((m[i][0] * rgb[0] + m[i][1] * rgb[1] + m[i][2] * rgb[2]) / white[i]);
    out.lab[0] = 116 * t[1] - 16, out.lab[1] = 5 * out.lab[0] * (t[0] - t[1]), out.lab[2] = 2 * out.lab[0] * (t[1] - t[2]);
    const double sd = 0.041 * ppd;
    const int r = int(std::ceil(3 * sd));
    for (bool point : {false, true}) {
      double plus = 0, minus = 0, x[2] = {}, y[2] = {};
      for (int j = -r; j <= r; ++j)
        for (int i = -r; i <= r; ++i) {
          const double g = std::exp(-(i * i + j * j) / (2 * sd * sd)), d = point ? (i * i / (sd * sd) - 1) * g : -i * g;
          double left[3];
          (d > 0 ? plus : minus) += std::fabs(d);
          opponent(image, px + i, py + j, o), x[d > 0] += std::fabs(d) * (o[0] + 16) / 116;
          opponent(image, px + j, py + i, left), y[d > 0] += std::fabs(d) * (left[0] + 16) / 116;
        }
      (point ? out.point : out.edge) = std::hypot(x[1] / plus - x[0] / minus, y[1] / plus - y[0] / minus);
    }
    return out;
  };
  const Local la = local(a), lb = local(b);
  const double da = -86.183 * 0.87735 - 79.191 * 0.32299, db = 83.180 * 0.87735 + 107.858 * 0.32299;
  const double largest = std::pow(87.735 - 32.299 + std::hypot(da, db), 0.7), knee = 0.4 * largest;
  const double powered = std::pow(std::fabs(la.lab[0] - lb.lab[0]) + std::hypot(la.lab[1] - lb.lab[1], la.lab[2] - lb.lab[2]), 0.7);
  ASSERT_LT(powered, knee);
  const double feature = std::sqrt(std::max(std::fabs(la.edge - lb.edge), std::fabs(la.point - lb.point)) / std::sqrt(2.0));
  ASSERT_GT(feature, 0.05);
  EXPECT_NEAR(flipMap(a, b, ppd)[size_t(py) * w + px], std::pow(0.95 / knee * powered, 1 - feature), 2e-3);
}

/// errorAgainstHalves is unbiased and its standard error is honest; the naive error against the mean of the halves is neither.
TEST(Halves, UnbiasedWhereTheNaiveEstimateIsNot) {
  const int w = 64, h = 64, trials = 60;
  const double noise = 0.2, offset = 0.05;
  const Image picture = constant(w, h, Vec3(float(1 + offset)));
  Stream random(9);
  double sum = 0, sum2 = 0, stated = 0, naive = 0, rel = 0, relStated = 0;
  for (int t = 0; t < trials; ++t) {
    Image a = constant(w, h, Vec3(1)), b = a, mean = a;
    for (size_t i = 0; i < a.data.size(); ++i) {
      a.data[i] = float(1 + noise * random.normal()), b.data[i] = float(1 + noise * random.normal());
      mean.data[i] = 0.5f * (a.data[i] + b.data[i]);
    }
    const auto e = errorAgainstHalves(picture, a, b);
    ASSERT_TRUE(e.ok());
    const double d = e->mse - offset * offset, n = std::pow(compareImages(picture, mean, std::vector<uint8_t>(size_t(w * h), 1))->rmse, 2);
    sum += d, sum2 += d * d, stated += e->standardError, naive += n / trials;
    rel += e->relMse / trials, relStated += e->relMseStandardError / trials;
  }
  const double bias = sum / trials, deviation = std::sqrt(sum2 / trials - bias * bias);
  EXPECT_LT(std::fabs(bias), 3.5 * deviation / std::sqrt(trials));  // t-test, 0.05 %
  EXPECT_NEAR(stated / trials, deviation, 0.35 * deviation);        // 60 trials: +- 9 % is one deviation
  EXPECT_NEAR(naive, offset * offset + noise * noise / 2, 0.001);   // nine times the truth
  EXPECT_GT((naive - offset * offset) / deviation, 10);
  // relMSE divides by the noisy truth and is biased where the noise is four times the error: the stated error says so.
  EXPECT_LT(std::fabs(rel - offset * offset / 1.01), relStated);
}

/// With halves whose noise is like the error relMSE is right within the error that it states, which is small.
TEST(Halves, RelativeErrorOfQuietHalves) {
  const int w = 256, h = 256;
  Stream random(10);
  Image picture(w, h, 3), a(w, h, 3), b(w, h, 3);
  double truth = 0;
  for (size_t i = 0; i < a.data.size(); ++i) {
    const double t = 0.05 + double(i % 97) / 97, d = 0.03 * t + 0.02;
    picture.data[i] = float(t + d), a.data[i] = float(t + 0.03 * random.normal()), b.data[i] = float(t + 0.03 * random.normal());
    truth += d * d / (t * t + 0.01) / double(a.data.size());
  }
  const auto e = errorAgainstHalves(picture, a, b);
  EXPECT_LT(std::fabs(e->relMse - truth), e->relMseStandardError);
  EXPECT_LT(e->relMseStandardError, 0.15 * truth);
}

TEST(DifferenceImage, SignsAndScale) {
  Image a = constant(3, 1, Vec3(0.5f)), b = a;
  for (int c = 0; c < 3; ++c) a.at(0, 0)[c] += 0.1f, a.at(2, 0)[c] -= 0.05f;
  const Image d = differenceImage(a, b, 0.1f);
  EXPECT_NEAR(d.at(0, 0)[0], 1, 1e-5);
  EXPECT_NEAR(d.at(0, 0)[2], 0, 1e-5);
  EXPECT_EQ(d.rgb(1, 0), Vec3(1));
  EXPECT_NEAR(d.at(2, 0)[2], 1, 1e-5);
  EXPECT_NEAR(d.at(2, 0)[0], 0.5, 1e-4);
}

}  // namespace
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Filters of pictures (filters/picture) against closed forms: gains by frequency, impulse responses, aliases, Parseval, Gibbs, breakdown points, energies; and
// what any of them is held to: borders, sizes, extremes.
#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <numbers>

#include "filters/picture/picture_filters.h"
#include "unit/filters/synthetic.h"

namespace gobo {
namespace {

using namespace test;
constexpr double kTurn = 2.0 * std::numbers::pi;
using Kernels = v1::ResampleFilter;

using Value = std::function<double(int x, int y, int c)>;

PictureShape shaped(int width, int height, int channels = 3) { return {{width, height, 1}, Domain::Pixel, "rgb", channels, false}; }

TermPtr pictureOf(int width, int height, const Value& f, int channels = 3) {
  auto t = std::make_shared<Term>("picture", Domain::Pixel, Extent{width, height, 1});
  auto v = t->addPlane<float>("rgb", channels);
  for (int y = 0, i = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < channels; ++c, ++i) v[size_t(i)] = float(f(x, y, c));
  return t;
}

struct Made {
  TermPtr term;
  int width, channels;
  double at(int x, int y, int c = 0) const { return double(term->floats("rgb")[size_t((y * width + x) * channels + c)]); }
  std::span<const float> all() const { return term->floats("rgb"); }
};
Made filtered(const NodePtr& node, const TermPtr& in, int threads = 2) { return {runFilter(node, {in}, threads), in->extent().width, in->channels("rgb")}; }

double noise(int x, int y, int c) { return double(toUnit(hash32(77, uint64_t((y * 977 + x) * 3 + c)))); }
double impulse(int x, int y, int cx, int cy) { return x == cx && y == cy ? 1.0 : 0.0; }

struct Named {
  const char* name;
  std::function<NodePtr(PictureShape)> make;
};
/// One of each at settings that do something, for what holds of all.
std::vector<Named> everyFilter() {
  return {{"gaussian", [](PictureShape s) { return makeGaussianNode(s, 1.3); }},
          {"sharpen", [](PictureShape s) { return makeSharpenNode(s, 1.1, 1.5); }},
          {"median", [](PictureShape s) { return makeMedianNode(s, 1, 0); }},
          {"median of 25", [](PictureShape s) { return makeMedianNode(s, 2, 0); }},
          {"median by deviations", [](PictureShape s) { return makeMedianNode(s, 2, 1.5); }},
          {"bilateral", [](PictureShape s) { return makeBilateralNode(s, 1.2, 0.3); }},
          {"bloom", [](PictureShape s) { return makeBloomNode(s, 0.5, 0.4, 2.0); }},
          {"compression", [](PictureShape s) { return makeCompressionNode(s, 0.2); }},
          {"resample", [](PictureShape s) { return makeResampleNode(s, 2.5, Kernels::LANCZOS, true); }},
          {"resample without prefilter", [](PictureShape s) { return makeResampleNode(s, 3, Kernels::MITCHELL, false); }},
          {"color_balance", [](PictureShape s) {
             return makeColorBalanceNode(s, {0.9, 0.5, 0.1}, 0.6, true);
           }}};
}

TEST(PictureFilters, ConstantPicturesKeepTheirValueUpToTheBorder) {
  for (const auto& [name, make] : everyFilter())
    for (const auto& [w, h] : {std::pair(31, 17), std::pair(5, 3)})
      for (const double value : {0.25, 0.1, 3e-8, 1e8}) {
        if (std::string(name) == "color_balance" || (std::string(name) == "bloom" && value > 0.5)) continue;
        const Made out = filtered(make(shaped(w, h)), pictureOf(w, h, [&](int, int, int) { return value; }));
        for (const float v : out.all()) ASSERT_NEAR(v / value, 1.0, 3e-7) << name << " " << w << " x " << h << " of " << value;
      }
}

TEST(PictureFilters, SmoothingAConstantKeepsItsBits) {
  const TermPtr in = pictureOf(37, 23, [](int, int, int c) { return 0.1 + 0.37 * c; });
  for (const double sigma : {0.4, 1.0, 5.0, 40.0}) {
    const auto out = filtered(makeGaussianNode(shaped(37, 23), sigma), in);
    ASSERT_TRUE(std::equal(out.all().begin(), out.all().end(), in->floats("rgb").begin())) << sigma;
  }
}

TEST(PictureFilters, TheNarrowestBilateralLeavesThePicture) {
  const TermPtr in = pictureOf(13, 9, noise);
  for (const double sigma : {1e-300, 1e-170, 1e-30, 1e-3}) {
    const auto out = filtered(makeBilateralNode(shaped(13, 9), sigma, 0.3), in);
    ASSERT_TRUE(std::equal(out.all().begin(), out.all().end(), in->floats("rgb").begin())) << sigma;
  }
}

TEST(PictureFilters, MirroredBordersLoseNoLight) {
  // The sum of a picture is that of any smoothing of it, wherever light is, for kernels wider than the picture too.
  for (const auto& [w, h] : {std::pair(16, 11), std::pair(7, 13), std::pair(1, 1), std::pair(1, 9)})
    for (const double sigma : {0.7, 2.0, 9.0, 30.0}) {
      const TermPtr in = pictureOf(w, h, noise);
      double before = 0, after = 0;
      for (const float v : in->floats("rgb")) before += double(v);
      const Made out = filtered(makeGaussianNode(shaped(w, h), sigma), in);
      for (const float v : out.all()) after += double(v);
      EXPECT_NEAR(after, before, 1e-6 * before) << w << " x " << h << " " << sigma;
    }
}

TEST(PictureFilters, AnyFilterOfAPictureIsThatOfItsMirrorExtension) {
  // Put together with its mirror images in all directions, the middle is what the picture alone became. Compression repeats and is left out.
  const int w = 13, h = 9;
  for (const auto& [name, make] : everyFilter()) {
    if (std::string(name) == "compression") continue;
    if (std::string(name).rfind("resample", 0) == 0) continue;  // whose samples lie elsewhere in the larger picture: below
    const TermPtr in = pictureOf(w, h, noise);
    const Made out = filtered(make(shaped(w, h)), in);
    const auto value = in->floats("rgb");
    const Made tiled = filtered(make(shaped(5 * w, 5 * h)), pictureOf(5 * w, 5 * h, [&](int x, int y, int c) {
                                  return double(value[size_t((mirrored(y - 2 * h, h) * w + mirrored(x - 2 * w, w)) * 3 + c)]);
                                }));
    // The bloom's tail ends at the picture's size, which is another there.
    const double tolerance = std::string(name) == "bloom" ? 5e-3 : 1e-6;
    for (int y = 0; y < h; ++y)
      for (int x = 0; x < w; ++x)
        for (int c = 0; c < 3; ++c) ASSERT_NEAR(out.at(x, y, c), tiled.at(x + 2 * w, y + 2 * h, c), tolerance) << name << " " << x << "," << y;
  }
}

TEST(PictureFilters, AnySizeAndExtremesStayFinite) {
  constexpr double kMost = std::numeric_limits<float>::max();
  for (const auto& [name, make] : everyFilter())
    for (const auto& [w, h] : {std::pair(1, 1), std::pair(2, 1), std::pair(1, 7), std::pair(31, 1), std::pair(37, 41)})
      for (const int kind : {0, 1, 2, 3}) {
        const TermPtr in = pictureOf(w, h, [&](int x, int y, int c) {
          const bool odd = (x + y + c) % 2;
          return kind == 0 ? (odd ? kMost : -kMost) : kind == 1 ? (odd ? 1e8 : 1e-8) : kind == 2 ? 0.0 : kMost;
        });
        const Made out = filtered(make(shaped(w, h)), in);
        for (const float v : out.all()) {
          ASSERT_TRUE(std::isfinite(v)) << name << " " << w << " x " << h << " kind " << kind;
          if (kind == 2) { ASSERT_EQ(v, 0.0f) << name; }
        }
      }
}

TEST(PictureFilters, SharesStayShares) {
  for (const auto& [name, make] : everyFilter()) {
    PictureShape shape = shaped(24, 20);
    shape.share = true;
    const NodePtr node = make(shape);
    if (!node->traits().rangePreserving) continue;  // bloom and colour balance are of light
    const Made out = filtered(node, pictureOf(24, 20, [](int x, int y, int) { return (x / 3 + y / 5) % 2; }));
    for (const float v : out.all()) ASSERT_TRUE(v >= 0.0f && v <= 1.0f) << name << " " << v;
  }
  // They do leave it otherwise.
  const Made over = filtered(makeSharpenNode(shaped(24, 20), 1.1, 1.5), pictureOf(24, 20, [](int x, int, int) { return x / 6 % 2; }));
  EXPECT_GT(*std::max_element(over.all().begin(), over.all().end()), 1.1f);
  EXPECT_LT(*std::min_element(over.all().begin(), over.all().end()), -0.1f);
}

TEST(PictureFilters, VariancesOfGaussiansAdd) {
  const int n = 121;
  const TermPtr in = pictureOf(n, n, [](int x, int y, int) { return impulse(x, y, 60, 60); });
  const auto moments = [&](const Made& m) {
    double sum = 0, mean = 0, square = 0;
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x) sum += m.at(x, y), mean += m.at(x, y) * (x - 60), square += m.at(x, y) * (x - 60) * (x - 60);
    EXPECT_NEAR(sum, 1.0, 1e-6);
    EXPECT_NEAR(mean, 0.0, 1e-5);
    return square / sum;
  };
  const Made a = filtered(makeGaussianNode(shaped(n, n), 3.0), in), b = filtered(makeGaussianNode(shaped(n, n), 4.0), in);
  const Made both = filtered(makeGaussianNode(shaped(n, n), 4.0), a.term);
  EXPECT_NEAR(moments(a), 9.0, 0.02);  // cut at 4 sigma: 0.1 % less
  EXPECT_NEAR(moments(both), moments(a) + moments(b), 1e-4);
  const Made five = filtered(makeGaussianNode(shaped(n, n), 5.0), in);
  for (int y = 30; y < 90; ++y)
    for (int x = 30; x < 90; ++x) ASSERT_NEAR(both.at(x, y), five.at(x, y), 2e-5);
  // The impulse response is the Gaussian.
  for (int d = 0; d <= 12; ++d) EXPECT_NEAR(a.at(60 + d, 60), std::exp(-d * d / 18.0) / (kTurn * 9.0), 2e-5) << d;
}

TEST(PictureFilters, GainsByFrequency) {
  // cos is mirrored into itself where half periods fit: its gain is the kernel's transform.
  const int n = 64;
  for (const int half : {0, 1, 5, 16, 40, 63}) {
    const double w = std::numbers::pi * half / n;
    const auto wave = [&](int x, int, int) { return 1.5 + std::cos(w * (x + 0.5)); };
    const TermPtr in = pictureOf(n, 3, wave);
    const double sigma = 1.4;
    double g = 0, sum = 0;
    for (int k = -6; k <= 6; ++k) sum += std::exp(-0.5 * k * k / (sigma * sigma)), g += std::exp(-0.5 * k * k / (sigma * sigma)) * std::cos(w * k);
    g /= sum;
    EXPECT_NEAR(g, std::exp(-0.5 * w * w * sigma * sigma), 2e-3);
    const Made low = filtered(makeGaussianNode(shaped(n, 3), sigma), in), high = filtered(makeSharpenNode(shaped(n, 3), sigma, 0.7), in);
    for (int x = 0; x < n; ++x) {
      ASSERT_NEAR(low.at(x, 1), 1.5 + g * std::cos(w * (x + 0.5)), 1e-6) << half << " " << x;
      ASSERT_NEAR(high.at(x, 1), 1.5 + (1.0 + 0.7 * (1.0 - g)) * std::cos(w * (x + 0.5)), 2e-6) << half << " " << x;
    }
  }
}

TEST(PictureFilters, TheMedianRemovesLessThanHalfAndNoMore) {
  const int w = 40, h = 30;
  const auto ramp = [](int x, int y, int c) { return 0.01 * x + 0.02 * y + c; };
  // 12 of 25 in each window of a checker of 2-cycles are less than half: here every pixel of odd column in rows 0, 2 mod 5.
  for (const int radius : {1, 2, 3, 8}) {
    const int side = 2 * radius + 1, half = side * side / 2;
    // A block of `half` spoiled pixels around a window's middle leaves it; one more does not.
    for (const int spoiled : {half, half + 1}) {
      const TermPtr in = pictureOf(w, h, [&](int x, int y, int) {
        const int k = (y - (15 - radius)) * side + x - (20 - radius);
        return x >= 20 - radius && x <= 20 + radius && y >= 15 - radius && y <= 15 + radius && k < spoiled ? 1e6 : 0.5;
      });
      EXPECT_EQ(filtered(makeMedianNode(shaped(w, h), radius, 0), in).at(20, 15), spoiled == half ? 0.5 : 1e6) << radius;
    }
  }
  // A ramp stays where its windows are whole; with deviations it stays to the bit everywhere, and a spike on it goes.
  const TermPtr in = pictureOf(w, h, ramp);
  const Made median = filtered(makeMedianNode(shaped(w, h), 2, 0), in), mad = filtered(makeMedianNode(shaped(w, h), 2, 2.5), in);
  for (int y = 2; y < h - 2; ++y)
    for (int x = 2; x < w - 2; ++x)
      for (int c = 0; c < 3; ++c) {
        ASSERT_EQ(median.at(x, y, c), double(float(ramp(x, y, c))));
        ASSERT_EQ(mad.at(x, y, c), double(float(ramp(x, y, c))));
      }
  const Made spiked =
      filtered(makeMedianNode(shaped(w, h), 2, 2.5), pictureOf(w, h, [&](int x, int y, int c) { return ramp(x, y, c) + (x == 9 && y == 9 ? 5 : 0); }));
  EXPECT_NEAR(spiked.at(9, 9, 1), ramp(9, 9, 1), 0.05);
  EXPECT_EQ(spiked.at(10, 9, 1), double(float(ramp(10, 9, 1))));
}

TEST(PictureFilters, MediansAreThoseOfSortedWindows) {
  const int w = 19, h = 14;
  const TermPtr in = pictureOf(w, h, noise);
  const auto value = in->floats("rgb");
  for (const int radius : {1, 2, 5})
    for (const double deviations : {0.0, 1.0}) {
      const Made out = filtered(makeMedianNode(shaped(w, h), radius, deviations), in);
      for (int y = 0; y < h; ++y)
        for (int x = 0; x < w; ++x)
          for (int c = 0; c < 3; ++c) {
            std::vector<double> window;
            for (int j = -radius; j <= radius; ++j)
              for (int i = -radius; i <= radius; ++i) window.push_back(double(value[size_t((mirrored(y + j, h) * w + mirrored(x + i, w)) * 3 + c)]));
            std::sort(window.begin(), window.end());
            double expected = window[window.size() / 2];
            if (deviations > 0.0) {
              std::vector<double> apart;
              for (const double v : window) apart.push_back(std::abs(v - expected));
              std::sort(apart.begin(), apart.end());
              const double own = double(value[size_t((y * w + x) * 3 + c)]);
              if (std::abs(own - expected) <= deviations * apart[apart.size() / 2] + 1e-9) expected = own;
            }
            ASSERT_EQ(out.at(x, y, c), expected) << radius << " " << deviations << " at " << x << "," << y;
          }
    }
}

TEST(PictureFilters, BilateralLimits) {
  const int w = 26, h = 22;
  const TermPtr in = pictureOf(w, h, noise);
  const auto value = in->floats("rgb");
  // Against the definition.
  for (const auto& [sigma, range] : {std::pair(1.5, 0.2), std::pair(2.0, 1e9), std::pair(0.6, 0.05)}) {
    const Made out = filtered(makeBilateralNode(shaped(w, h), sigma, range), in);
    const int radius = int(std::ceil(3 * sigma));
    for (int y = 0; y < h; ++y)
      for (int x = 0; x < w; ++x) {
        double weights = 0, sum[3] = {0, 0, 0};
        const float* own = value.data() + size_t(y * w + x) * 3;
        for (int j = -radius; j <= radius; ++j)
          for (int i = -radius; i <= radius; ++i) {
            const float* v = value.data() + size_t(mirrored(y + j, h) * w + mirrored(x + i, w)) * 3;
            double d2 = 0;
            for (int c = 0; c < 3; ++c) d2 += (double(v[c]) - own[c]) * (double(v[c]) - own[c]);
            const double k = std::exp(-0.5 * (i * i + j * j) / (sigma * sigma) - 0.5 * d2 / (range * range));
            weights += k;
            for (int c = 0; c < 3; ++c) sum[c] += k * v[c];
          }
        for (int c = 0; c < 3; ++c) ASSERT_NEAR(out.at(x, y, c), sum[c] / weights, 2e-6) << sigma << " " << range << " at " << x << "," << y;
      }
  }
  // range -> infinity: the Gaussian, but for what lies between 3 and 4 sigma; -> 0: the picture, to the bit.
  const Made wide = filtered(makeBilateralNode(shaped(w, h), 2.0, 1e9), in), gaussian = filtered(makeGaussianNode(shaped(w, h), 2.0), in);
  for (size_t i = 0; i < value.size(); ++i) ASSERT_NEAR(wide.all()[i], gaussian.all()[i], 4e-3);
  const Made same = filtered(makeBilateralNode(shaped(w, h), 2.0, 1e-6), in);
  ASSERT_TRUE(std::equal(value.begin(), value.end(), same.all().begin()));
  // A spike far above the range survives, and so does an edge; the noise beside them does not.
  const Made spike = filtered(makeBilateralNode(shaped(w, h), 2.0, 0.1), pictureOf(w, h, [](int x, int y, int c) {
                                return (x == 7 && y == 7 ? 50.0 : x < 13 ? 1.0 : 3.0) + 0.02 * (noise(x, y, c) - 0.5);
                              }));
  EXPECT_NEAR(spike.at(7, 7), 50.0, 0.02);
  EXPECT_NEAR(spike.at(12, 15), 1.0, 0.005);
  EXPECT_NEAR(spike.at(13, 15), 3.0, 0.005);
}

TEST(PictureFilters, BloomAddsGainTimesTheExcessAndNothingElse) {
  for (const auto& [w, h] : {std::pair(48, 40), std::pair(37, 41), std::pair(23, 61), std::pair(1, 1), std::pair(3, 50)})
    for (const double radius : {0.5, 3.0, 40.0, 256.0}) {
      const TermPtr in = pictureOf(w, h, [](int x, int y, int c) { return (x * 7 + y * 3) % 11 == 0 ? 4.0 * noise(x, y, c) : 0.5 * noise(x, y, c); });
      const auto value = in->floats("rgb");
      double excess[3] = {0, 0, 0}, added[3] = {0, 0, 0};
      for (size_t p = 0; p < value.size(); p += 3) {
        const double y = 0.2126 * value[p] + 0.7152 * value[p + 1] + 0.0722 * value[p + 2];
        for (size_t c = 0; c < 3; ++c) excess[c] += y > 1.0 ? value[p + c] * (y - 1.0) / y : 0.0;
      }
      const Made out = filtered(makeBloomNode(shaped(w, h), 1.0, 0.3, radius), in);
      for (size_t i = 0; i < value.size(); ++i) {
        added[i % 3] += double(out.all()[i]) - value[i];
        ASSERT_GE(out.all()[i], value[i] - 1e-9f);
      }
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(added[c], 0.3 * excess[c], 1e-5 * (1.0 + excess[c])) << w << " x " << h << " " << radius;
    }
  // Nothing above the threshold: the same bits.
  const TermPtr dim = pictureOf(20, 20, noise);
  const Made same = filtered(makeBloomNode(shaped(20, 20), 1.0, 5.0, 4.0), dim);
  EXPECT_TRUE(std::equal(same.all().begin(), same.all().end(), dim->floats("rgb").begin()));
}

TEST(PictureFilters, HalfOfBloomsLightIsWithinItsRadiusAndItsTailIsLong) {
  const int n = 401;
  for (const double radius : {4.0, 8.0}) {
    const Made out = filtered(makeBloomNode(shaped(n, n), 0.0, 1.0, radius), pictureOf(n, n, [&](int x, int y, int) { return 1e4 * impulse(x, y, 200, 200); }));
    double within = 0, all = 0;
    const double a = radius / std::sqrt(3.0);
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x) {
        const double v = out.at(x, y) - 1e4 * impulse(x, y, 200, 200), r2 = (x - 200) * (x - 200) + (y - 200) * (y - 200);
        all += v;
        if (r2 <= radius * radius) within += v;
        if (r2 > 9 && r2 < 3600) {
          // The solid angle's density, a hair more for what is cut off.
          ASSERT_NEAR(v / (1e4 * a / (kTurn * std::pow(r2 + a * a, 1.5))), 1.03, 0.04) << radius << " at " << x << "," << y;
        }
      }
    EXPECT_NEAR(all, 1e4, 1.0);
    EXPECT_NEAR(within / all, 0.5, 0.03) << radius;
    EXPECT_GT(out.at(200 + int(10 * radius), 200), 1e-6 * 1e4 / (radius * radius)) << "a Gaussian would have nothing there";
  }
}

TEST(PictureFilters, CompressionKeepsTheStrongestCoefficients) {
  const int w = 30, h = 21;
  const TermPtr in = pictureOf(w, h, noise);
  const auto value = in->floats("rgb");
  // Its own transform, by the definition.
  std::vector<double> power;
  double energy = 0;
  for (int v = 0; v < h; ++v)
    for (int u = 0; u < w; ++u) {
      std::complex<double> f = 0;
      for (int y = 0; y < h; ++y)
        for (int x = 0; x < w; ++x) f += double(value[size_t((y * w + x) * 3)]) * std::polar(1.0, -kTurn * (double(u * x) / w + double(v * y) / h));
      power.push_back(std::norm(f));
    }
  std::sort(power.rbegin(), power.rend());
  for (size_t p = 0; p < value.size(); p += 3) energy += double(value[p]) * value[p];
  double sum = 0;
  for (const double p : power) sum += p;
  EXPECT_NEAR(sum, energy * w * h, 1e-6 * sum) << "Parseval";
  double last = 1e30;
  for (const double share : {0.0, 0.01, 0.05, 0.2, 0.5, 0.9, 0.9999}) {
    const Made out = filtered(makeCompressionNode(shaped(w, h), share), in);
    double kept = 0, lost = 0;
    for (size_t p = 0; p < value.size(); p += 3) {
      kept += double(out.all()[p]) * out.all()[p];
      lost += (double(out.all()[p]) - value[p]) * (double(out.all()[p]) - value[p]);
    }
    const size_t count = size_t(share * w * h + 0.5);
    double expected = 0;
    for (size_t k = 0; k < count; ++k) expected += power[k] / (w * h);
    const double pair = count > 0 && count < power.size() ? 2.0 * power[count - 1] / (w * h) : 0.0;  // conjugates stay together
    EXPECT_NEAR(kept, expected, pair + 1e-6 * energy) << share;
    EXPECT_NEAR(kept + lost, energy, 2e-6 * energy) << share << ": what is left out is orthogonal to what is kept";
    EXPECT_LE(lost, last * (1 + 1e-9)) << share;
    last = lost;
  }
  EXPECT_LT(last, 1e-3 * energy);
}

TEST(PictureFilters, ATruncatedStepOvershootsByGibbsShareOfItsJump) {
  // The strongest coefficients of a square wave are its lowest: the truncated series overshoots by Si(pi) / pi - 1/2 = 8.949 %.
  const int n = 2048;
  const TermPtr in = pictureOf(n, 1, [&](int x, int, int) { return x < n / 2 ? 0.0 : 2.0; });
  for (const int harmonics : {16, 32, 64}) {
    const Made out = filtered(makeCompressionNode(shaped(n, 1), (2.0 * harmonics + 1.0) / n), in);
    const double over = (*std::max_element(out.all().begin(), out.all().end()) - 2.0) / 2.0;
    EXPECT_NEAR(over, 0.08949, 1.5e-3) << harmonics;
  }
}

TEST(PictureFilters, PrimeSizesHaveTheTransformOfAnyOther) {
  // A wave with a whole number of periods is two coefficients: it survives alone, in sizes that are products of small primes and in primes.
  for (const auto& [w, h] : {std::pair(60, 48), std::pair(61, 47), std::pair(127, 37), std::pair(74, 1), std::pair(1, 131)}) {
    const TermPtr in = pictureOf(w, h, [&](int x, int y, int) { return std::cos(kTurn * (3.0 * x / w + 2.0 * y / h) + 0.4) + 1e-3 * (noise(x, y, 0) - 0.5); });
    const Made out = filtered(makeCompressionNode(shaped(w, h), 2.0 / (w * h)), in);
    for (int y = 0; y < h; ++y)
      for (int x = 0; x < w; ++x) ASSERT_NEAR(out.at(x, y), std::cos(kTurn * (3.0 * x / w + 2.0 * y / h) + 0.4), 5e-4) << w << " x " << h;
  }
}

TEST(PictureFilters, SamplesTakenWithoutAPrefilterComeBackAsAliases) {
  // Of band limit 16 sampled at 19 a unit: (1/32) cos 35 pi x and (1/4) cos 23 pi x become (1/32) cos 3 pi x and (1/4) cos 15 pi x (digest of the method, 2.1).
  const int factor = 11, unit = 19 * factor, n = 4 * unit;
  const double start = (factor - 1) / 2;
  const auto x01 = [&](int x) { return (x - start) / unit; };
  const TermPtr in =
      pictureOf(n, 2, [&](int x, int, int) { return std::cos(35 * std::numbers::pi * x01(x)) / 32 + std::cos(23 * std::numbers::pi * x01(x)) / 4; });
  const Made out = filtered(makeResampleNode(shaped(n, 2), factor, Kernels::LANCZOS, false), in);
  const auto alias = [&](int x) { return std::cos(3 * std::numbers::pi * x01(x)) / 32 + std::cos(15 * std::numbers::pi * x01(x)) / 4; };
  for (int s = 0; s * factor + int(start) < n; ++s) ASSERT_NEAR(out.at(s * factor + int(start), 1), alias(s * factor + int(start)), 2e-6) << s;
  // Well below half the rate the whole wave comes back, between the samples too; with the prefilter what is above it goes.
  const TermPtr fast = pictureOf(n, 2, [&](int x, int, int) { return std::cos(35 * std::numbers::pi * x01(x)); });
  const Made aliased = filtered(makeResampleNode(shaped(n, 2), factor, Kernels::LANCZOS, false), fast);
  const Made clean = filtered(makeResampleNode(shaped(n, 2), factor, Kernels::LANCZOS, true), fast);
  for (int x = 4 * factor; x < n - 4 * factor; ++x) {
    ASSERT_NEAR(aliased.at(x, 0), std::cos(3 * std::numbers::pi * x01(x)), 0.02) << x;
    ASSERT_NEAR(clean.at(x, 0), 0.0, 0.02) << x;
  }
}

TEST(PictureFilters, ResamplingByKernels) {
  // BOX is the mean of blocks.
  const int w = 24, h = 12, f = 4;
  const TermPtr in = pictureOf(w, h, noise);
  const Made box = filtered(makeResampleNode(shaped(w, h), f, Kernels::BOX, true), in);
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      double mean = 0;
      for (int j = 0; j < f; ++j)
        for (int i = 0; i < f; ++i) mean += noise(x / f * f + i, y / f * f + j, 1) / (f * f);
      ASSERT_NEAR(box.at(x, y, 1), mean, 1e-6);
    }
  // Without a prefilter it shows one pixel of each block.
  const Made taken = filtered(makeResampleNode(shaped(w, h), f, Kernels::BOX, false), in);
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      std::vector<double> candidates;
      for (int j = 0; j < f; ++j)
        for (int i = 0; i < f; ++i) candidates.push_back(double(float(noise(x / f * f + i, y / f * f + j, 1))));
      ASSERT_LT(std::abs(*std::min_element(candidates.begin(), candidates.end(),
                                           [&](double a, double b) { return std::abs(a - taken.at(x, y, 1)) < std::abs(b - taken.at(x, y, 1)); }) -
                         taken.at(x, y, 1)),
                1.0);
    }
  // Slow waves come back by all that are meant for it, the sharper kernel the nearer; ramps by TENT and MITCHELL to rounding, away from the borders.
  const auto error = [&](Kernels::Kernel kernel) {
    const TermPtr slow = pictureOf(200, 1, [](int x, int, int) { return std::cos(kTurn * (x + 0.5) / 50); });
    const Made out = filtered(makeResampleNode(shaped(200, 1), 4, kernel, true), slow);
    double most = 0;
    for (int x = 0; x < 200; ++x) most = std::max(most, std::abs(out.at(x, 0) - std::cos(kTurn * (x + 0.5) / 50)));
    return most;
  };
  EXPECT_LT(error(Kernels::LANCZOS), 0.02);
  EXPECT_LT(error(Kernels::LANCZOS), error(Kernels::MITCHELL));
  EXPECT_LT(error(Kernels::MITCHELL), error(Kernels::TENT));
  EXPECT_LT(error(Kernels::TENT), error(Kernels::GAUSSIAN) + 0.05);
  EXPECT_LT(error(Kernels::MITCHELL), 0.1);
  for (const Kernels::Kernel kernel : {Kernels::TENT, Kernels::MITCHELL}) {
    const Made out = filtered(makeResampleNode(shaped(120, 1), 5, kernel, false), pictureOf(120, 1, [](int x, int, int) { return 0.1 * x - 3; }));
    for (int x = 25; x < 95; ++x) ASSERT_NEAR(out.at(x, 0), 0.1 * x - 3, 1e-5) << x;
  }
}

TEST(PictureFilters, ASampleIsTakenInTheMiddleOfWhatIsItsOwn) {
  // The centre of light stays where it is, for any factor.
  for (const double factor : {1.5, 2.0, 3.0, 4.7, 16.0})
    for (const Kernels::Kernel kernel : {Kernels::BOX, Kernels::TENT, Kernels::GAUSSIAN, Kernels::MITCHELL, Kernels::LANCZOS}) {
      const int n = 240;
      const Made out = filtered(makeResampleNode(shaped(n, 1), factor, kernel, true),
                                pictureOf(n, 1, [](int x, int, int) { return std::exp(-0.5 * std::pow((x - 117.3) / 24, 2)); }));
      double sum = 0, mean = 0;
      for (int x = 0; x < n; ++x) sum += out.at(x, 0), mean += x * out.at(x, 0);
      EXPECT_NEAR(mean / sum, 117.3, 0.06) << factor << " " << kernel;
    }
}

TEST(PictureFilters, HalfTheDensityTwiceIsTheWholeOnce) {
  const TermPtr in = pictureOf(9, 7, noise);
  const std::array<double, 3> wratten{0.9, 0.55, 0.12};
  const Made once = filtered(makeColorBalanceNode(shaped(9, 7), wratten, 0.8, false), in);
  const NodePtr half = makeColorBalanceNode(shaped(9, 7), wratten, 0.4, false);
  const Made twice = filtered(half, filtered(half, in).term);
  for (int y = 0; y < 7; ++y)
    for (int x = 0; x < 9; ++x)
      for (int c = 0; c < 3; ++c) {
        ASSERT_NEAR(once.at(x, y, c), std::pow(wratten[size_t(c)], 0.8) * noise(x, y, c), 1e-7);
        ASSERT_NEAR(twice.at(x, y, c), once.at(x, y, c), 1e-7);
      }
  // Greys keep their luminance where it is asked for; a filter that lets nothing through leaves nothing.
  const Made grey = filtered(makeColorBalanceNode(shaped(9, 7), wratten, 1.0, true), pictureOf(9, 7, [](int, int, int) { return 0.4; }));
  EXPECT_NEAR(0.2126 * grey.at(3, 3, 0) + 0.7152 * grey.at(3, 3, 1) + 0.0722 * grey.at(3, 3, 2), 0.4, 1e-6);
  EXPECT_NEAR(grey.at(3, 3, 0) / grey.at(3, 3, 2), 0.9 / 0.12, 1e-5);
  const Made black = filtered(makeColorBalanceNode(shaped(9, 7), {0, 0, 0}, 1.0, true), in);
  for (const float v : black.all()) ASSERT_EQ(v, 0.0f);
}

TEST(PictureFilters, PolledWhereTheyAre) {
  // Each ends at any poll, with what it said.
  for (const auto& [name, make] : everyFilter()) {
    const TermPtr in = pictureOf(40, 40, [](int x, int y, int c) { return 4 * noise(x, y, c); });
    const NodePtr node = make(shaped(40, 40));
    for (const int poll : {1, 2, 7, 20}) {
      TaskArena arena(1);
      StopSource source;
      source.stopAtPoll(poll);
      RunContext ctx;
      ctx.inputs = {in};
      ctx.arena = &arena;
      ctx.stop = source.token();
      const Result<TermPtr> r = runNode(*node, ctx);
      if (!r.ok()) EXPECT_EQ(r.status().code(), Code::Cancelled) << name;
      else EXPECT_GT(source.pollsLeft(), 0) << name << " did not see poll " << poll;
    }
  }
}

}  // namespace
}  // namespace gobo

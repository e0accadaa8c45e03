// SPDX-License-Identifier: Apache-2.0
// Mean and deviation of differences of luminance, and the exponential display, against closed forms.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "measure/luminance_difference.h"

namespace gobo {
namespace {

const double kNotANumber = std::numeric_limits<double>::quiet_NaN(), kEndless = std::numeric_limits<double>::infinity();

TEST(ExponentialDisplay, IsItsCurve) {
  EXPECT_EQ(displayedByExponential(0, 3), 0);
  EXPECT_EQ(displayedByExponential(-2, 3), 0);
  EXPECT_EQ(displayedByExponential(5, 0), 0);
  EXPECT_NEAR(displayedByExponential(2, 0.5), 1 - 1 / std::numbers::e, 1e-15);
  EXPECT_EQ(displayedByExponential(1e300, 1), 1);
  EXPECT_EQ(displayedByExponential(kEndless, 1), 1);
  EXPECT_TRUE(std::isnan(displayedByExponential(kNotANumber, 1)));
  for (const double x : {1e-12, 0.03, 1.0, 700.0}) EXPECT_NEAR(displayedByExponential(x, exposureOfHalf(x)), 0.5, 1e-15) << x;
  double before = 0;
  for (double x = 1e-6; x < 30; x *= 1.1) {
    const double y = displayedByExponential(x, 1);
    EXPECT_GT(y, before);  // monotone
    EXPECT_LT(y, 1);
    before = y;
  }
  // Linear for faint light: c x (1 - c x / 2 + ...), to the last digits.
  for (const double x : {1e-18, 1e-12, 1e-7}) EXPECT_NEAR(displayedByExponential(x, 2) / (2 * x), 1 - x, 1e-13) << x;
}

TEST(LuminanceDifference, OfAConstantIsThatAndHasNoDeviation) {
  std::vector<double> a, b;
  for (int i = 0; i < 1000; ++i) {
    b.push_back(0.25 * (i % 9));
    a.push_back(b.back() + (i % 2 ? 0.5 : -0.5));
  }
  const auto d = luminanceDifference(a, b, 1);
  ASSERT_TRUE(d.ok());
  EXPECT_EQ(d->mean, 0.5);
  EXPECT_EQ(d->deviation, 0);
  EXPECT_EQ(d->pixels, 1000u);
  const auto none = luminanceDifference(b, b, 1);
  EXPECT_EQ(none->mean, 0);
  EXPECT_EQ(none->shownMean, 0);
  EXPECT_EQ(none->shownDeviation, 0);
}

// A part p of the pixels differs by u, the rest by v: mean p u + (1 - p) v, deviation |u - v| sqrt(p (1 - p)). What is displayed is two-valued too.
TEST(LuminanceDifference, OfTwoValuesIsTheirClosedForm) {
  for (const auto& [of, u, v, c] : {std::tuple(2, 1.0, 0.0, 1.0), std::tuple(4, 3.0, 0.25, 0.5), std::tuple(10, 0.125, 2.0, 3.0)}) {
    std::vector<double> a, b;
    for (int i = 0; i < 40 * of; ++i) {
      b.push_back(1.5);
      a.push_back(i % of == 0 ? 1.5 + u : 1.5 - v);
    }
    const double p = 1.0 / of, spread = std::sqrt(p * (1 - p));
    const double up = std::exp(-1.5 * c) * (1 - std::exp(-c * u));
    const double down = 1.5 - v >= 0 ? std::exp(-1.5 * c) * (std::exp(c * v) - 1) : 1 - std::exp(-1.5 * c);  // light below 0 shows as none
    const auto d = luminanceDifference(a, b, c);
    ASSERT_TRUE(d.ok());
    EXPECT_NEAR(d->mean, p * u + (1 - p) * v, 1e-14);
    EXPECT_NEAR(d->deviation, std::fabs(u - v) * spread, 1e-14);
    EXPECT_NEAR(d->shownMean, p * up + (1 - p) * down, 1e-14);
    EXPECT_NEAR(d->shownDeviation, std::fabs(up - down) * spread, 1e-14);
    // Neither picture is the first.
    const auto back = luminanceDifference(b, a, c);
    EXPECT_EQ(back->mean, d->mean);
    EXPECT_EQ(back->shownDeviation, d->shownDeviation);
  }
}

TEST(LuminanceDifference, ExposureActsOnWhatIsDisplayedAlone) {
  const std::vector<double> a{0.5, 2.0, 8.0}, b{1.0, 1.0, 9.0};
  const auto dim = luminanceDifference(a, b, 1e-9), bright = luminanceDifference(a, b, 1e3), off = luminanceDifference(a, b, 0);
  EXPECT_NEAR(dim->shownMean / (1e-9 * dim->mean), 1, 1e-7);  // linear
  EXPECT_NEAR(dim->shownDeviation / (1e-9 * dim->deviation), 1, 1e-7);
  EXPECT_LT(bright->shownMean, 1e-100);  // all white
  EXPECT_EQ(off->shownMean, 0);
  for (const auto& d : {bright, off}) EXPECT_EQ(d->mean, dim->mean);
}

TEST(LuminanceDifference, TakesTheWeightsOfRec709) {
  Image image(3, 1, 3);
  for (size_t c = 0; c < 3; ++c) image.data[4 * c] = 2.0f;  // red, green, blue
  const std::vector<double> y = luminancesOf(image);
  ASSERT_EQ(y.size(), 3u);
  EXPECT_NEAR(y[0], 2 * 0.2126, 1e-15);
  EXPECT_NEAR(y[1], 2 * 0.7152, 1e-15);
  EXPECT_NEAR(y[2], 2 * 0.0722, 1e-15);
  Image alpha(2, 1, 4), grey(2, 1, 1);
  alpha.data = {1, 1, 1, 0, 0.5f, 0.5f, 0.5f, 7};
  grey.data = {1, 0.5f};
  for (const Image* i : {&alpha, &grey}) {
    EXPECT_NEAR(luminancesOf(*i)[0], 1, 1e-15);
    EXPECT_NEAR(luminancesOf(*i)[1], 0.5, 1e-15);
  }
}

TEST(LuminanceDifference, MasksChooseTheirPixels) {
  const std::vector<double> a{1, 2, 3, kNotANumber, 9}, b{1, 1, 1, 1, kEndless};
  const auto of = [&](std::vector<uint8_t> mask) { return *luminanceDifference(a, b, 1, mask); };
  EXPECT_EQ(of({1, 1, 0, 0, 0}).mean, 0.5);
  EXPECT_EQ(of({0, 0, 200, 0, 0}).mean, 2);
  EXPECT_EQ(of({0, 1, 1, 1, 0}).mean, 1.5);
  EXPECT_EQ(of({0, 1, 1, 1, 0}).nonFinite, 1u);
  EXPECT_EQ(of({0, 1, 1, 1, 0}).pixels, 2u);
  const auto all = luminanceDifference(a, b, 1);
  EXPECT_EQ(all->pixels, 3u);
  EXPECT_EQ(all->nonFinite, 2u);
  EXPECT_EQ(all->mean, 1);
  for (const auto& none : {of({0, 0, 0, 0, 0}), of({0, 0, 0, 1, 1})}) {
    EXPECT_EQ(none.pixels, 0u);
    EXPECT_EQ(none.mean, 0);
    EXPECT_EQ(none.shownDeviation, 0);
  }
}

TEST(LuminanceDifference, RefusesWhatCannotBeCompared) {
  const std::vector<double> two{1, 2}, three{1, 2, 3}, none;
  const std::vector<uint8_t> mask{1};
  const auto refused = [](const auto& r, const char* text) {
    return !r.ok() && r.status().code() == Code::InvalidArgument && r.status().toString().find(text) != std::string::npos;
  };
  EXPECT_TRUE(refused(luminanceDifference(two, three, 1), "2 and 3 pixels"));
  EXPECT_TRUE(refused(luminanceDifference(none, none, 1), "empty picture"));
  EXPECT_TRUE(refused(luminanceDifference(two, two, 1, mask), "1 entries for 2"));
  for (const double c : {-1.0, kNotANumber, kEndless}) EXPECT_TRUE(refused(luminanceDifference(two, two, c), "exposure"));
}

// Differences of a third of 1e9 +- 1e-3 over 4 M pixels: squares would leave nothing of the deviation, and a plain sum is off by more than it.
TEST(LuminanceDifference, KeepsItsDigitsOverFourMillionPixels) {
  constexpr size_t kPixels = size_t(1) << 22;
  std::vector<double> a(kPixels), b(kPixels, 0.0);
  for (size_t i = 0; i < kPixels; ++i) a[i] = 1e9 / 3 + (i % 2 ? 1e-3 : -1e-3);
  const auto d = luminanceDifference(a, b, 3e-9);
  ASSERT_TRUE(d.ok());
  EXPECT_EQ(d->pixels, kPixels);
  EXPECT_NEAR(d->mean / (1e9 / 3), 1, 1e-15);
  EXPECT_NEAR(d->deviation / 1e-3, 1, 1e-4);  // 1e9 / 3 + 1e-3 itself is rounded by 3e-8
  EXPECT_NEAR(d->shownMean, 1 - 1 / std::numbers::e, 1e-12);
}

TEST(EdgeMask, SelectsWhatIsWithinReachOfAStep) {
  constexpr int kWidth = 12, kHeight = 7;
  std::vector<double> step(kWidth * kHeight), faint(step.size());
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      step[size_t(y * kWidth + x)] = x < 6 ? 1.0 : 0.5;
      faint[size_t(y * kWidth + x)] = x < 6 ? 1.0 : 0.7;
    }
  for (const int reach : {0, 1, 2, 3}) {
    const auto mask = edgeMask(step, kWidth, kHeight, reach);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) EXPECT_EQ(mask[size_t(y * kWidth + x)], x >= 6 - reach && x < 6 + reach) << x << " " << reach;
  }
  for (const uint8_t m : edgeMask(faint, kWidth, kHeight)) EXPECT_FALSE(m);  // less than a third
  for (const double scale : {1e-3, 1e3}) {                                   // whatever the exposure
    std::vector<double> dim = step, dimFaint = faint;
    for (double& v : dim) v *= scale;
    for (double& v : dimFaint) v *= scale;
    EXPECT_EQ(edgeMask(dim, kWidth, kHeight), edgeMask(step, kWidth, kHeight));
    EXPECT_EQ(edgeMask(dimFaint, kWidth, kHeight), edgeMask(faint, kWidth, kHeight));
  }
  for (const uint8_t m : edgeMask(faint, kWidth, kHeight, 12, 0.29)) EXPECT_TRUE(m);
  // A spot in the dark, in both directions; black and NaN have no edges.
  std::vector<double> spot(step.size(), 0.0);
  spot[3 * kWidth + 4] = 1;
  spot[0] = kNotANumber;
  const auto around = edgeMask(spot, kWidth, kHeight, 1);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) EXPECT_EQ(around[size_t(y * kWidth + x)], std::abs(x - 4) <= 1 && std::abs(y - 3) <= 1) << x << " " << y;
  EXPECT_TRUE(edgeMask({}, 0, 0).empty());
}

}  // namespace
}  // namespace gobo

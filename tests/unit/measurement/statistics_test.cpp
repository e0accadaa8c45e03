// SPDX-License-Identifier: Apache-2.0
// Quantiles against numpy's, intervals for the median against binomial sums and by coverage, errors of repeats.
#include "measurement/statistics.h"

#include <algorithm>
#include <cmath>
#include <random>

#include <gtest/gtest.h>

namespace gobo::cli {
namespace {

TEST(Quantile, IsLinearBetweenOrderStatistics) {
  // numpy.quantile([7, 1, 3, 10], p)
  const std::vector<double> v{7, 1, 3, 10};
  EXPECT_DOUBLE_EQ(quantile(v, 0), 1);
  EXPECT_DOUBLE_EQ(quantile(v, 0.25), 2.5);
  EXPECT_DOUBLE_EQ(quantile(v, 0.5), 5);
  EXPECT_DOUBLE_EQ(quantile(v, 0.75), 7.75);
  EXPECT_DOUBLE_EQ(quantile(v, 1), 10);
  EXPECT_DOUBLE_EQ(quantile({4}, 0.3), 4);
  EXPECT_DOUBLE_EQ(quantile({2, 1, 3}, 0.5), 2);
}

TEST(Times, QuartilesAndEnds) {
  const TimeFigures t = timeFigures({5, 1, 2, 4, 3});
  EXPECT_DOUBLE_EQ(t.median, 3);
  EXPECT_DOUBLE_EQ(t.lowerQuartile, 2);
  EXPECT_DOUBLE_EQ(t.upperQuartile, 4);
  EXPECT_DOUBLE_EQ(t.least, 1);
  EXPECT_DOUBLE_EQ(t.most, 5);
}

/// P(Binomial(n, 1/2) < k) by a sum of Pascal's row.
double lowerTail(int n, int k) {
  double sum = 0, choose = 1;
  for (int i = 0; i < k; ++i) {
    sum += choose;
    choose = choose * (n - i) / (i + 1);
  }
  return sum / std::pow(2.0, n);
}

TEST(Times, IntervalOfTheMedianIsTheNarrowestPairThatCoversIt) {
  for (int n = 1; n <= 60; ++n) {
    std::vector<double> times;
    for (int i = n; i >= 1; --i) times.push_back(i);  // the k-th smallest is k
    const TimeFigures t = timeFigures(times);
    const int k = int(t.low);
    EXPECT_EQ(t.high, n + 1 - k) << n;
    EXPECT_LE(t.low, t.median);
    EXPECT_NEAR(t.confidence, std::max(0.0, 1 - 2 * lowerTail(n, k)), 1e-12) << n;
    if (n >= 6) {
      EXPECT_GE(t.confidence, 0.95) << n;
      EXPECT_LT(1 - 2 * lowerTail(n, k + 1), 0.95) << n;
    } else {
      EXPECT_EQ(k, 1) << n;
      EXPECT_LT(t.confidence, 0.95) << n;
    }
  }
  EXPECT_EQ(timeFigures({3}).confidence, 0);
  const TimeFigures many = timeFigures(std::vector<double>(1000, 2.0));  // 2^-1000 and less
  EXPECT_EQ(many.low, 2);
  EXPECT_NEAR(many.confidence, 0.95, 0.01);
}

TEST(Times, IntervalCoversTheMedianOfSkewedTimes) {
  std::mt19937_64 random(20260713);
  std::exponential_distribution<double> delay(1);  // median ln 2
  int covered = 0;
  constexpr int kTrials = 4000;
  double expected = 0;
  for (int i = 0; i < kTrials; ++i) {
    std::vector<double> times(11);
    for (double& t : times) t = 10 + delay(random);
    const TimeFigures f = timeFigures(times);
    covered += f.low <= 10 + std::log(2.0) && 10 + std::log(2.0) <= f.high;
    expected = f.confidence;
  }
  EXPECT_NEAR(double(covered) / kTrials, expected, 4 * std::sqrt(expected * (1 - expected) / kTrials));
}

HalvesError errorOf(double mse, double se, double low, double high) {
  HalvesError e;
  e.mse = mse, e.standardError = se, e.mseLow = low, e.mseHigh = high;
  e.relMse = 2 * mse, e.relMseStandardError = 2 * se;
  return e;
}

TEST(Errors, EqualPicturesSayNoMoreThanOne) {
  HalvesError one = errorOf(4, 0.5, 3, 6);
  one.nonFinite = 2;
  for (const size_t n : {1u, 2u, 7u}) {
    const ErrorFigure f = errorFigure(std::vector<HalvesError>(n, one));
    EXPECT_NEAR(f.mse, 4, 1e-14);
    EXPECT_NEAR(f.mseStandardError, 0.5, 1e-14);
    EXPECT_NEAR(f.mseLow, 3, 1e-14);
    EXPECT_NEAR(f.mseHigh, 6, 1e-14);
    EXPECT_NEAR(f.rmse, 2, 1e-14);
    EXPECT_NEAR(f.rmseLow, std::sqrt(3.0), 1e-14);
    EXPECT_NEAR(f.rmseHigh, std::sqrt(6.0), 1e-14);
    EXPECT_NEAR(f.relMse, 8, 1e-14);
    EXPECT_NEAR(f.relMseStandardError, 1, 1e-14);
    EXPECT_EQ(f.nonFinite, 2u);
  }
}

TEST(Errors, DifferentPicturesWidenTheInterval) {
  const ErrorFigure f = errorFigure({errorOf(1, 0, 1, 1), errorOf(2, 0, 2, 2), errorOf(3, 0, 3, 3)});
  EXPECT_NEAR(f.mse, 2, 1e-14);
  const double se = 1 / std::sqrt(3.0);  // deviation 1 of three
  EXPECT_NEAR(f.mseStandardError, se, 1e-14);
  EXPECT_NEAR(f.mseHigh, 2 + 4.302652729911275 * se, 1e-9);  // Student's t of two degrees
  EXPECT_EQ(f.mseLow, 0);                                    // would be below
  const ErrorFigure two = errorFigure({errorOf(1, 0.3, 0.7, 1.3), errorOf(1.2, 0.3, 0.9, 1.5)});
  EXPECT_NEAR(two.mseHigh, 1.1 + std::hypot(0.3, 12.706204736432095 * 0.1), 1e-9);
  std::vector<HalvesError> nine;
  for (int i = 0; i < 9; ++i) nine.push_back(errorOf(10 + (i - 4), 0, 10 + (i - 4), 10 + (i - 4)));
  EXPECT_NEAR(errorFigure(nine).mseHigh, 10 + 2.306004 * std::sqrt(60.0 / 72), 2e-3);  // t of eight degrees: 2.306004
}

TEST(Errors, EstimatesBelowNothingAreNoRoots) {
  const ErrorFigure f = errorFigure({errorOf(-0.1, 0.1, 0, 0.2)});
  EXPECT_DOUBLE_EQ(f.mse, -0.1);
  EXPECT_EQ(f.rmse, 0);
  EXPECT_EQ(f.rmseLow, 0);
  EXPECT_NEAR(f.rmseHigh, std::sqrt(0.2), 1e-14);
  const ErrorFigure far = errorFigure({errorOf(-1, 0.1, 0, 0)});
  EXPECT_EQ(far.rmseHigh, 0);
}

}  // namespace
}  // namespace gobo::cli

// SPDX-License-Identifier: Apache-2.0
// Combined correlated and importance sampling: its laws of variance, no bias, exact ends.
#include "filters/outliers/combined_sampling.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "base/sobol.h"

namespace gobo {
namespace combined_sampling_test {

using outliers::Combination;
using outliers::combinedEstimate;

constexpr Combination kAll[] = {Combination::Additive, Combination::Subtractive, Combination::Combined, Combination::Ratio};

double uniform(uint64_t trial, uint64_t i) { return double(hash64(trial, i) >> 11) * 0x1p-53; }

struct Pairs {
  std::vector<double> f, g;
};
/// g exponential of mean 1 (c = 1), shown with probability v.
Pairs pairs(uint64_t trial, int n, double v) {
  Pairs p;
  for (int i = 0; i < n; ++i) {
    p.g.push_back(-std::log(1 - uniform(trial, uint64_t(2 * i))));
    p.f.push_back(uniform(trial, uint64_t(2 * i + 1)) < v ? p.g.back() : 0.0);
  }
  return p;
}
struct Moments {
  double mean = 0, variance = 0, error = 0;
};
Moments momentsOf(int n, double v, Combination how, uint64_t trials) {
  double sum = 0, squares = 0;
  for (uint64_t t = 0; t < trials; ++t) {
    const Pairs p = pairs(t, n, v);
    const double e = combinedEstimate(p.f, p.g, 1.0, how);
    sum += e;
    squares += e * e;
  }
  const double m = sum / double(trials), var = squares / double(trials) - m * m;
  return {m, var, std::sqrt(var / double(trials))};
}

TEST(CombinedSampling, VariancesAreThoseOfTheLaw) {
  // n times the variance over C^2; c = 1. The noise of beta is of the order of 1 / n (a tenth at 64 samples of such tails).
  const int n = 256;
  for (const double v : {0.1, 0.5, 0.9}) {
    const double shown = v * (1 - v), law[] = {shown + v, shown + 1 - v, 2 * shown, 2 * shown};
    for (int k = 0; k < 4; ++k) EXPECT_NEAR(n * momentsOf(n, v, kAll[k], 10000).variance, law[k], 0.07 * law[k]) << "v " << v << ", " << k;
  }
}

TEST(CombinedSampling, HasNoBiasAtAnyNumberOfSamples) {
  for (const int n : {1, 2, 3, 4, 8}) {
    const Moments m = momentsOf(n, 0.7, Combination::Combined, 200000);
    EXPECT_NEAR(m.mean, 0.7, 4 * m.error) << n;
  }
  // f depends on g: whatever the best beta is, it is not what makes the estimate right.
  double sum = 0, squares = 0;
  constexpr int kTrials = 200000;
  for (uint64_t t = 0; t < kTrials; ++t) {
    Pairs p = pairs(t, 4, 1.0);
    for (size_t i = 0; i < p.f.size(); ++i) p.f[i] = p.g[i] > 1 ? p.g[i] : 0.0;  // mean 2 / e
    const double e = combinedEstimate(p.f, p.g, 1.0, Combination::Combined);
    sum += e / kTrials;
    squares += e * e / kTrials;
  }
  EXPECT_NEAR(sum, 2 / M_E, 4 * std::sqrt((squares - sum * sum) / kTrials));
}

TEST(CombinedSampling, NeighboursLowerTheNoiseOfBetaAndBringNoBias) {
  // Four samples of an own pixel (C = 1, v = 0.7) beside 32 of others that are ten times as bright and darker (v = 0.4): beta is not the best one, but has
  // little noise. n times the variance with beta' for the best v is v (1 - v)(1 + c^2) + (beta' - v)^2 c^2; as much again for noise of 1 / 32.
  constexpr int kOwn = 4, kTrials = 100000;
  double sum = 0, squares = 0, alone = 0, aloneSquares = 0;
  for (uint64_t t = 0; t < kTrials; ++t) {
    const Pairs p = pairs(t, kOwn, 0.7), near = pairs(t + 1000000, 32, 0.4);
    outliers::PairSums around;
    for (size_t i = 0; i < near.f.size(); ++i) around.add(10 * near.f[i], 10 * near.g[i], 10.0);
    const double e = outliers::combinedWith(p.f, p.g, 1.0, around), own = combinedEstimate(p.f, p.g, 1.0, Combination::Combined);
    sum += e / kTrials;
    squares += e * e / kTrials;
    alone += own / kTrials;
    aloneSquares += own * own / kTrials;
  }
  const double variance = squares - sum * sum, law = 0.42 + 0.3 * 0.3;
  EXPECT_NEAR(sum, 0.7, 4 * std::sqrt(variance / kTrials));
  EXPECT_GT(kOwn * variance, 0.75 * law);
  EXPECT_LT(kOwn * variance, 1.15 * law);
  EXPECT_LT(variance, 0.5 * (aloneSquares - alone * alone));
  // Pixels without light say nothing.
  outliers::PairSums dark;
  dark.add(0, 0, 0);
  EXPECT_EQ(dark.n, 0);
}

TEST(CombinedSampling, EndsAreExact) {
  Pairs lit = pairs(3, 9, 2.0), dark = pairs(3, 9, -1.0);
  EXPECT_EQ(combinedEstimate(lit.f, lit.g, 1.0, Combination::Subtractive), 1.0);
  EXPECT_NEAR(combinedEstimate(lit.f, lit.g, 1.0, Combination::Combined), 1.0, 1e-12);
  EXPECT_NEAR(combinedEstimate(lit.f, lit.g, 1.0, Combination::Ratio), 1.0, 1e-12);
  EXPECT_EQ(combinedEstimate(dark.f, dark.g, 1.0, Combination::Additive), 0.0);
  EXPECT_EQ(combinedEstimate(dark.f, dark.g, 1.0, Combination::Combined), 0.0);
  EXPECT_EQ(combinedEstimate(dark.f, dark.g, 1.0, Combination::Ratio), 0.0);
  EXPECT_GT(std::abs(combinedEstimate(dark.f, dark.g, 1.0, Combination::Subtractive)), 0.01) << "light that is left, or negative";
}

TEST(CombinedSampling, WithoutAVaryingMainPartItIsTheMean) {
  const std::vector<double> f{1, 0, 1, 1}, even(4, 0.1), none(4, 0.0);
  for (const Combination how : {Combination::Combined, Combination::Additive}) {
    EXPECT_NEAR(combinedEstimate(f, even, 0.1, how), 0.75, 1e-15);
    EXPECT_EQ(combinedEstimate(f, none, 0.0, how), 0.75);
    EXPECT_EQ(combinedEstimate({}, {}, 1.0, how), 0.0);
  }
  EXPECT_EQ(combinedEstimate(f, none, 0.0, Combination::Ratio), 0.75);
  // One other sample besides the two: cov / var of it alone is noise, not beta.
  const std::vector<double> two{1, 3};
  EXPECT_EQ(combinedEstimate(two, two, 5.0, Combination::Combined), 2.0);
}

}  // namespace combined_sampling_test
}  // namespace gobo

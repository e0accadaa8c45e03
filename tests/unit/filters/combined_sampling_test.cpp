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

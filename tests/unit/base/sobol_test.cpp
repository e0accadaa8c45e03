// SPDX-License-Identifier: Apache-2.0
// Oracles: published Sobol points, the net property (counting), permutation trees, moments.
#include "base/sobol.h"

#include <gtest/gtest.h>

#include <set>
#include <vector>

namespace gobo {
namespace {

TEST(Sobol, MatchesThePublishedFirstPoints) {
  // Joe & Kuo's points in Gray-code order.
  const double expected[8][4] = {{0, 0, 0, 0},
                                 {.5, .5, .5, .5},
                                 {.75, .25, .25, .25},
                                 {.25, .75, .75, .75},
                                 {.375, .375, .625, .875},
                                 {.875, .875, .125, .375},
                                 {.625, .125, .875, .625},
                                 {.125, .625, .375, .125}};
  for (uint32_t n = 0; n < 8; ++n)
    for (int d = 0; d < 4; ++d) EXPECT_EQ(double(sobolBits(n ^ (n >> 1), d)) * 0x1p-32, expected[n][d]) << n << " dimension " << d;
}

TEST(Sobol, PascalButterfliesEqualBinomialsModuloTwo) {
  for (uint32_t index : {1u, 2u, 3u, 77u, 0x80000000u, 0xdeadbeefu, 0xffffffffu}) {
    uint32_t expected = 0;
    for (int i = 0; i < 32; ++i)
      for (int j = i; j < 32; ++j)
        if (((j & i) == i) && ((index >> j) & 1u)) expected ^= 1u << i;  // Lucas: C(j, i) is odd iff i's bits are in j
    EXPECT_EQ(pascalDigits(index), expected);
  }
}

TEST(OwenScramble, PermutesEveryLevelOfTheBinaryTree) {
  for (uint32_t seed : {0u, 1u, 0x12345678u, 0xffffffffu}) {
    for (int level = 1; level <= 8; ++level) {
      std::set<uint32_t> seen;
      for (uint32_t cell = 0; cell < (1u << level); ++cell) {
        const uint32_t low = cell << (32 - level), high = low | (~0u >> level);
        const uint32_t a = owenScramble(low, seed) >> (32 - level);
        EXPECT_EQ(a, owenScramble(high, seed) >> (32 - level));  // an interval maps to one interval of its size ...
        seen.insert(a);
      }
      EXPECT_EQ(seen.size(), 1u << level);  // ... and no two to the same
    }
  }
}

/// Every elementary interval of area 2^-m holds exactly one of the 2^m points.
void expectNet(uint64_t seed, uint32_t first, int m, int draw) {
  const uint32_t n = 1u << m;
  std::vector<Vec2> points;
  for (uint32_t i = 0; i < n; ++i) {
    SobolSampler s(seed, first + i);
    for (int d = 0; d < draw; ++d) s.next2D();
    points.push_back(s.next2D());
  }
  for (int k = 0; k <= m; ++k) {
    std::vector<int> count(n, 0);
    for (const Vec2& p : points) ++count[(uint32_t(p.x * float(1u << k)) << (m - k)) + uint32_t(p.y * float(1u << (m - k)))];
    for (uint32_t c = 0; c < n; ++c) ASSERT_EQ(count[c], 1) << "seed " << seed << " draw " << draw << " split " << k;
  }
}

TEST(SobolSampler, AlignedBlocksAreNetsInEveryDraw) {
  for (uint64_t seed : {0ull, 7ull, 0xfedcba9876543210ull})
    for (int draw : {0, 1, 5, 40}) {
      expectNet(seed, 0, 4, draw);
      expectNet(seed, 16, 4, draw);
      expectNet(seed, 0, 6, draw);
      expectNet(seed, 192, 6, draw);
      expectNet(seed, 0, 10, draw);
    }
}

TEST(SobolSampler, OneDimensionalDrawsAreStratified) {
  std::vector<int> count(64, 0);
  for (uint32_t i = 0; i < 64; ++i) {
    SobolSampler s(99, i);
    s.next2D();
    ++count[int(s.next1D() * 64.0f)];
  }
  for (int c : count) EXPECT_EQ(c, 1);
}

TEST(SobolSampler, DrawsStayBelowOneAndAverageOneHalf) {
  for (uint64_t seed = 0; seed < 16; ++seed) {
    double sum1 = 0, sumX = 0, sumY = 0;
    const int n = 4096;
    for (int i = 0; i < n; ++i) {
      SobolSampler s(seed, uint32_t(i));
      const float a = s.next1D();
      const Vec2 b = s.next2D();
      for (float v : {a, b.x, b.y}) {
        ASSERT_GE(v, 0.0f);
        ASSERT_LT(v, 1.0f);
      }
      sum1 += a;
      sumX += b.x;
      sumY += b.y;
    }
    // One point in each of n strata: the mean's deviation is 1 / sqrt(12 n) / n.
    for (double sum : {sum1, sumX, sumY}) EXPECT_NEAR(sum / n, 0.5, 5.0 / (n * std::sqrt(12.0 * n)) + 1.0 / (1 << 24));
  }
  EXPECT_LT(toUnit(~0u), 1.0f);
}

/// The first sample alone, over seeds, is uniform: the scramble is what makes each point unbiased.
TEST(SobolSampler, OnePointIsUniformOverSeeds) {
  const int n = 16384, bins = 64;
  std::vector<int> count(bins, 0);
  for (int seed = 0; seed < n; ++seed) ++count[int(SobolSampler{uint64_t(seed), 0}.next1D() * bins)];
  double chi2 = 0;
  for (int c : count) chi2 += sqr(float(c) - float(n) / bins) / (double(n) / bins);
  EXPECT_LT(chi2, 110.0);  // 63 degrees of freedom: p = 2e-4
  EXPECT_GT(chi2, 30.0);
}

double correlation(const std::vector<float>& a, const std::vector<float>& b) {
  double sa = 0, sb = 0, saa = 0, sbb = 0, sab = 0;
  const double n = double(a.size());
  for (size_t i = 0; i < a.size(); ++i) {
    sa += a[i];
    sb += b[i];
    saa += double(a[i]) * a[i];
    sbb += double(b[i]) * b[i];
    sab += double(a[i]) * b[i];
  }
  return (sab / n - sa / n * sb / n) / std::sqrt((saa / n - sqr(float(sa / n))) * (sbb / n - sqr(float(sb / n))));
}

TEST(SobolSampler, DimensionsAndSeedsAreUncorrelated) {
  const int n = 4096, draws = 12, seeds = 4;
  std::vector<std::vector<float>> columns;
  for (int seed = 0; seed < seeds; ++seed)
    for (int d = 0; d < draws; ++d) {
      std::vector<float> x(n), y(n);
      for (int i = 0; i < n; ++i) {
        SobolSampler s{uint64_t(seed), uint32_t(i)};
        for (int k = 0; k < d; ++k) s.next1D();
        const Vec2 v = s.next2D();
        x[i] = v.x;
        y[i] = v.y;
      }
      columns.push_back(std::move(x));
      columns.push_back(std::move(y));
    }
  double worst = 0;
  for (size_t a = 0; a < columns.size(); ++a)
    for (size_t b = a + 1; b < columns.size(); ++b) worst = std::max(worst, std::fabs(correlation(columns[a], columns[b])));
  // 4560 pairs: for independent uniforms the largest of |r| sqrt(n) lies near 4; 5.2 has Sidak chance 1e-3.
  EXPECT_LT(worst * std::sqrt(double(n)), 5.2);
}

TEST(SobolSampler, IsAFunctionOfItsArguments) {
  SobolSampler a(3, 5), b(3, 5), c(4, 5), d(3, 6);
  const Vec2 v = a.next2D();
  EXPECT_EQ(v, b.next2D());
  EXPECT_NE(v, c.next2D());
  EXPECT_NE(v, d.next2D());
}

}  // namespace
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Oracles: closed forms of the plain points, counting in intervals, laws of the scramble over seeds, slopes of the error.
#include "base/halton.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <set>
#include <vector>

#include "base/independent.h"

namespace gobo {
namespace {

uint64_t toThe(uint32_t base, int k) {
  uint64_t n = 1;
  for (; k > 0; --k) n *= base;
  return n;
}
/// Which of `cells` intervals a 32-bit fixed-point number that was rounded down lies in.
uint64_t cellOf(uint32_t bits, uint64_t cells) { return ((uint64_t(bits) * 2 + 1) * cells) >> 33; }
uint64_t cellOf(float x, uint64_t cells) { return uint64_t((double(x) + 0x1p-25) * double(cells)); }

TEST(Halton, PlainPointsAreTheClosedForms) {
  const uint32_t two[8][2] = {{0, 1}, {1, 2}, {1, 4}, {3, 4}, {1, 8}, {5, 8}, {3, 8}, {7, 8}};
  const uint32_t three[10][2] = {{0, 1}, {1, 3}, {2, 3}, {1, 9}, {4, 9}, {7, 9}, {2, 9}, {5, 9}, {8, 9}, {1, 27}};
  for (uint32_t i = 0; i < 8; ++i) EXPECT_EQ(radicalInverse(i, 2), uint32_t((uint64_t(two[i][0]) << 32) / two[i][1])) << i;
  for (uint32_t i = 0; i < 10; ++i) EXPECT_EQ(radicalInverse(i, 3), uint32_t((uint64_t(three[i][0]) << 32) / three[i][1])) << i;
  EXPECT_EQ(radicalInverse(0xfffffffeu, 2), 0x7fffffffu);
  EXPECT_EQ(radicalInverse(4u + 5u * 3733u, 3733), uint32_t((uint64_t(4u * 3733u + 5u) << 32) / (3733u * 3733u)));
}

TEST(Halton, EveryDimensionHasAPrimeOfItsOwn) {
  uint32_t n = 2;
  for (uint32_t pair = 0; pair < kHaltonPairs; ++pair)
    for (int second = 0; second < 2; ++second, ++n) {
      while ([&] {
        for (uint32_t d = 2; d * d <= n; ++d)
          if (n % d == 0) return true;
        return false;
      }())
        ++n;
      ASSERT_EQ(haltonPrime(pair, second), n) << pair;
    }
}

constexpr uint32_t kBases[] = {2, 3, 5, 7, 11, 13, 31, 101, 211, 2311, 3733};

/// b^k points from a multiple of b^k on have one in each interval of length b^-k, and which one a point has depends on its last k digits alone.
TEST(Halton, ScrambledPrefixesHaveOnePointInEachInterval) {
  for (const uint32_t base : kBases)
    for (int k = 1; toThe(base, k) <= 4096; ++k)
      for (const uint64_t scramble : {0ull, 7ull, 0xfedcba9876543210ull}) {
        const uint64_t n = toThe(base, k);
        std::vector<uint64_t> first;
        for (const uint64_t block : {uint64_t(0), uint64_t(1), uint64_t(base), (uint64_t(1) << 32) / n - 1}) {
          std::vector<uint64_t> cells;
          for (uint64_t i = 0; i < n; ++i) cells.push_back(cellOf(scrambledRadicalInverse(uint32_t(block * n + i), base, scramble), n));
          if (block == 0) first = cells;
          ASSERT_EQ(cells, first) << base << "^" << k;
        }
        std::sort(first.begin(), first.end());
        for (uint64_t c = 0; c < n; ++c) ASSERT_EQ(first[c], c) << base << "^" << k;
      }
}

TEST(HaltonSampler, PairsHaveOnePointInEachRectangle) {
  for (const uint32_t pair : {0u, 1u, 3u})
    for (const uint64_t seed : {0ull, 11ull, 0xfedcba9876543210ull})
      for (int i = 0; i <= 5; ++i)
        for (int j = 0; j <= 5; ++j) {
          const uint64_t columns = toThe(haltonPrime(pair, 0), i), rows = toThe(haltonPrime(pair, 1), j), n = columns * rows;
          if (n > 3000) continue;
          for (const uint64_t first : {uint64_t(0), 3 * n}) {
            std::vector<int> count(n, 0);
            for (uint64_t k = 0; k < n; ++k) {
              HaltonSampler s(seed, uint32_t(first + k));
              for (uint32_t d = 0; d < pair; ++d) s.next2D();
              const Vec2 p = s.next2D();
              ++count[cellOf(p.x, columns) * rows + cellOf(p.y, rows)];
            }
            for (const int c : count) ASSERT_EQ(c, 1) << "pair " << pair << ": " << columns << " x " << rows;
          }
        }
}

double chiSquare(const std::vector<int>& count) {
  double n = 0, sum = 0;
  for (const int c : count) n += c;
  for (const int c : count) sum += (c - n / double(count.size())) * (c - n / double(count.size()));
  return sum * double(count.size()) / n;
}
/// Within 4.5 standard deviations of the mean.
void expectEven(const std::vector<int>& count, const std::string& what) {
  const double freedom = double(count.size()) - 1;
  EXPECT_NEAR(chiSquare(count), freedom, 4.5 * std::sqrt(2 * freedom)) << what;
}

/// Over seeds each point is uniform, down to below its last digit, and two points whose first digits differ have any two others.
TEST(Halton, ScramblesAreUniformAndSoAreTheirPairsOfDigits) {
  for (const uint32_t base : kBases) {
    const int bins = 60, n = 60000;
    for (const uint32_t index : {0u, 1u, base * base + 2, 0xffffffffu}) {
      std::vector<int> coarse(bins, 0), fine(bins, 0);
      for (int s = 0; s < n; ++s) {
        const double x = double(scrambledRadicalInverse(index, base, hash64(99, uint64_t(s)))) * 0x1p-32;
        ++coarse[size_t(x * bins)];
        const double below = x * double(base) * 7.0;
        ++fine[size_t((below - std::floor(below)) * bins)];
      }
      expectEven(coarse, "base " + std::to_string(base) + " index " + std::to_string(index));
      expectEven(fine, "base " + std::to_string(base) + " index " + std::to_string(index) + " below the first digit");
    }
    if (base == 2 || base > 31) continue;
    std::vector<int> digits;
    for (const auto& [a, b] : {std::pair(0u, 1u), {1u, 2u}, {1u, base - 1}}) {
      if (a == b) continue;
      std::vector<int> count(size_t(base) * base, 0);
      for (int s = 0; s < n; ++s) {
        const uint64_t scramble = hash64(7, uint64_t(s));
        ++count[cellOf(scrambledRadicalInverse(a, base, scramble), base) * base + cellOf(scrambledRadicalInverse(b, base, scramble), base)];
      }
      digits.clear();
      for (uint32_t x = 0; x < base; ++x)
        for (uint32_t y = 0; y < base; ++y) {
          if (x == y) EXPECT_EQ(count[x * base + y], 0);
          else digits.push_back(count[x * base + y]);
        }
      expectEven(digits, "base " + std::to_string(base) + " digits " + std::to_string(a) + ", " + std::to_string(b));
    }
  }
}

/// What is below the first digit has permutations of its own for each first digit, and a pair's second dimension others than its first.
TEST(Halton, ScramblesOfOtherDigitsAndDimensionsAreIndependent) {
  const int n = 60000;
  for (const uint32_t base : {3u, 5u, 7u, 11u})
    for (const auto& [a, b] : {std::pair(0u, 1u), {1u, 2u}, {base + 1, 2 * base + 2}}) {
      std::vector<int> count(size_t(base) * base, 0);
      for (int s = 0; s < n; ++s) {
        const uint64_t scramble = hash64(13, uint64_t(s)), cells = uint64_t(base) * base;
        const uint64_t x = cellOf(scrambledRadicalInverse(a, base, scramble), cells), y = cellOf(scrambledRadicalInverse(b, base, scramble), cells);
        ++count[(x % base) * base + y % base];
      }
      expectEven(count, "base " + std::to_string(base) + " second digits of " + std::to_string(a) + ", " + std::to_string(b));
    }
  for (const uint32_t pair : {0u, 1u, 2u, 40u})
    for (const uint32_t index : {0u, 1u, 6u}) {
      std::vector<int> count(256, 0);
      for (int s = 0; s < n; ++s) {
        const Vec2 p = haltonPoint(hash64(21, uint64_t(s)), index, pair);
        ++count[size_t(p.x * 16) * 16 + size_t(p.y * 16)];
      }
      expectEven(count, "pair " + std::to_string(pair) + " of sample " + std::to_string(index));
    }
}

/// 16 samples in a large base are spread like random ones: by multiples alone they would all lie in a quarter of the interval for one seed in fifty.
TEST(Halton, FewSamplesInALargeBaseDoNotCluster) {
  for (const uint32_t base : {97u, 211u, 1009u}) {
    int clustered = 0;
    for (uint64_t seed = 0; seed < 4000; ++seed) {
      uint32_t lowest = ~0u, highest = 0;
      for (uint32_t i = 0; i < 16; ++i) {
        const uint32_t x = scrambledRadicalInverse(i, base, hash64(3, seed));
        lowest = std::min(lowest, x);
        highest = std::max(highest, x);
      }
      clustered += double(highest - lowest) * 0x1p-32 < 0.4;
    }
    EXPECT_LT(clustered, 3) << base;  // uniform numbers: 16 * 0.4^15 - 15 * 0.4^16 = 1e-5 each
  }
}

TEST(HaltonSampler, NumbersStayBelowOneAndDimensionsAreUncorrelated) {
  const uint32_t pairs[] = {0, 1, 2, 5, 17, 60, 129, kHaltonPairs - 1, kHaltonPairs, kHaltonPairs + 7};
  const int n = 4096;
  double worst = 0;
  for (const uint64_t seed : {1ull, 2ull, 3ull}) {
    std::vector<std::vector<double>> columns;
    for (const uint32_t pair : pairs) {
      std::vector<double> x, y;
      for (int i = 0; i < n; ++i) {
        const Vec2 p = haltonPoint(seed, uint32_t(i), pair);
        x.push_back(std::sqrt(12.0) * (double(p.x) - 0.5));
        y.push_back(std::sqrt(12.0) * (double(p.y) - 0.5));
      }
      columns.push_back(x);
      columns.push_back(y);
    }
    for (size_t a = 0; a < columns.size(); ++a)
      for (size_t b = a + 1; b < columns.size(); ++b) {
        double sum = 0;
        for (int i = 0; i < n; ++i) sum += columns[a][size_t(i)] * columns[b][size_t(i)];
        worst = std::max(worst, std::fabs(sum) / std::sqrt(double(n)));
      }
  }
  EXPECT_LT(worst, 4.7);  // 570 pairs of standard normal numbers: Sidak chance 1e-3
  for (uint64_t seed = 0; seed < 256; ++seed)
    for (const uint32_t pair : pairs)
      for (const uint32_t index : {0u, 1u, 0x7fffffffu, 0xfffffffeu, 0xffffffffu}) {
        const Vec2 p = haltonPoint(seed, index, pair);
        ASSERT_TRUE(p.x >= 0.0f && p.x < 1.0f && p.y >= 0.0f && p.y < 1.0f) << pair << " " << index;
      }
}

/// Beyond the primes numbers are independent: a sample's numbers there tell nothing of each other, nor of those in the same base again.
TEST(HaltonSampler, BeyondThePrimesNumbersAreIndependent) {
  for (uint32_t i = 0; i < 100; ++i) {
    EXPECT_EQ(haltonPoint(5, i, kHaltonPairs), independentPoint(5, i, kHaltonPairs));
    EXPECT_EQ(haltonValue(5, i, kHaltonPairs + 1), independentPoint(5, i, kHaltonPairs + 1).x);
    EXPECT_NE(haltonPoint(5, i, kHaltonPairs - 1), independentPoint(5, i, kHaltonPairs - 1));
  }
}

TEST(IndependentSampler, FillsEveryTwoDimensionsEvenly) {
  std::vector<int> within(256, 0), across(256, 0), next(256, 0);
  for (uint32_t i = 0; i < 65536; ++i) {
    IndependentSampler s(42, i);
    const Vec2 p = s.next2D();
    const float q = s.next1D(), other = IndependentSampler(42, i + 1).next1D();
    ASSERT_TRUE(p.x >= 0.0f && p.x < 1.0f && p.y >= 0.0f && p.y < 1.0f && q >= 0.0f && q < 1.0f);
    ++within[size_t(p.x * 16) * 16 + size_t(p.y * 16)];
    ++across[size_t(p.x * 16) * 16 + size_t(q * 16)];
    ++next[size_t(p.x * 16) * 16 + size_t(other * 16)];
  }
  expectEven(within, "a pair");
  expectEven(across, "two draws");
  expectEven(next, "two samples");
}

template <class Sampler>
void expectDraws() {
  Sampler a(3, 5), b(3, 5), c(4, 5), d(3, 6);
  const float x = a.next1D();
  EXPECT_EQ(x, b.next2D().x);
  EXPECT_NE(x, c.next1D());
  EXPECT_NE(x, d.next1D());
  EXPECT_EQ(a.next2D(), b.next2D());
}
TEST(HaltonSampler, IsAFunctionOfItsArguments) {
  expectDraws<HaltonSampler>();
  expectDraws<IndependentSampler>();
}

// Slopes: how the root of the mean squared error over seeds falls with the number of samples, by least squares in logarithms.

using Integrand = std::function<double(const Vec2&, const Vec2&)>;

struct Fall {
  double slope = 0, last = 0;  ///< last: the error at the largest number
};

template <class Sampler>
Fall fallOf(const Integrand& f, double truth, const std::vector<uint32_t>& counts, const char* name) {
  const int seeds = 256;
  std::vector<double> squares(counts.size(), 0.0);
  for (int seed = 0; seed < seeds; ++seed) {
    double sum = 0;
    uint32_t i = 0;
    for (size_t c = 0; c < counts.size(); ++c) {
      for (; i < counts[c]; ++i) {
        Sampler s(hash64(17, uint64_t(seed)), i);
        const Vec2 a = s.next2D(), b = s.next2D();
        sum += f(a, b);
      }
      squares[c] += std::pow(sum / counts[c] - truth, 2) / seeds;
    }
  }
  double sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (size_t c = 0; c < counts.size(); ++c) {
    const double x = std::log(double(counts[c])), y = 0.5 * std::log(squares[c]);
    sx += x;
    sy += y;
    sxx += x * x;
    sxy += x * y;
  }
  const double n = double(counts.size()), slope = (n * sxy - sx * sy) / (n * sxx - sx * sx);
  std::printf("  %s: slope %.3f, error %.2e at %u\n", name, slope, std::sqrt(squares.back()), counts.back());
  return {slope, std::sqrt(squares.back())};
}

const std::vector<uint32_t> kCounts = {16, 32, 64, 128, 256, 512, 1024, 2048};

TEST(Slopes, OfASmoothIntegrandOfTwoDimensions) {
  const Integrand f = [](const Vec2& a, const Vec2&) { return std::exp(double(a.x) + double(a.y)); };
  const double truth = std::pow(std::exp(1.0) - 1.0, 2);
  EXPECT_NEAR(fallOf<IndependentSampler>(f, truth, kCounts, "independent").slope, -0.5, 0.05);
  EXPECT_LT(fallOf<HaltonSampler>(f, truth, kCounts, "Halton").slope, -0.9);
  EXPECT_LT(fallOf<SobolSampler>(f, truth, kCounts, "Sobol").slope, -1.2);  // nets of two dimensions: -3/2 and a logarithm
}

/// Sobol draws of two dimensions each are shuffled against each other: what two of them do together falls as independent numbers' error does. Halton
/// points have all their dimensions together.
TEST(Slopes, OfASmoothIntegrandOfFourDimensions) {
  const Integrand f = [](const Vec2& a, const Vec2& b) { return (0.5 + double(a.x)) * (0.5 + double(a.y)) * (0.5 + double(b.x)) * (0.5 + double(b.y)); };
  const Fall independent = fallOf<IndependentSampler>(f, 1.0, kCounts, "independent"), halton = fallOf<HaltonSampler>(f, 1.0, kCounts, "Halton"),
             sobol = fallOf<SobolSampler>(f, 1.0, kCounts, "Sobol");
  EXPECT_NEAR(independent.slope, -0.5, 0.05);
  EXPECT_LT(halton.slope, -0.85);
  EXPECT_NEAR(sobol.slope, -0.5, 0.1);
  EXPECT_LT(sobol.last, 0.45 * independent.last);
  EXPECT_LT(halton.last, 0.15 * sobol.last);
}

TEST(Slopes, OfADiscontinuousIntegrand) {
  const Integrand f = [](const Vec2& a, const Vec2&) { return double(a.x) * a.x + double(a.y) * a.y < 1.0 ? 1.0 : 0.0; };
  const double truth = 3.14159265358979323846 / 4;
  EXPECT_NEAR(fallOf<IndependentSampler>(f, truth, kCounts, "independent").slope, -0.5, 0.05);
  EXPECT_LT(fallOf<HaltonSampler>(f, truth, kCounts, "Halton").slope, -0.65);  // -3/4 where an edge is all that there is
  EXPECT_LT(fallOf<SobolSampler>(f, truth, kCounts, "Sobol").slope, -0.65);
}

}  // namespace
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Percentage-closer filtering (Reeves, Salesin, Cook 1987; Annen 2008, eq. 5.4), the exact target of every pre-filtered map, against sums in
// double over the whole kernel.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "unit/filters/shadow_map_cases.h"

namespace {

using namespace gobo;
using namespace gobo::shadowtest;
using Percentage = v1::PercentageCloserShadow;

constexpr int kSize = 45;
float rough(int x, int y) { return 0.2f + 0.6f * random01(91, uint64_t(y * 100 + x)); }
/// The same at larger scale, so that kernels exist which lie wholly on one side.
float blocks(int x, int y) { return 0.2f + 0.6f * random01(92, uint64_t(y / 11 * 100 + x / 11)); }

std::vector<Vec3> scattered(int n, uint64_t seed) {
  std::vector<Vec3> points;
  for (int i = 0; i < n; ++i) points.push_back({random01(seed, uint64_t(i)), random01(seed + 1, uint64_t(i)), 0.1f + 0.8f * random01(seed + 2, uint64_t(i))});
  return points;
}
double texel(float u) { return std::clamp(double(u) * kSize - 0.5, 0.0, kSize - 1.0); }

/// sum_ij wx_i wy_j [d <= z_ij] in double; w(i - t) is the kernel's weight of texel i at position t, taps beyond the map repeat its rim.
template <typename Weight>
double bruteForce(const Vec3& p, int reach, const Weight& weight) {
  const double tx = texel(p.x), ty = texel(p.y);
  double sum = 0;
  for (int j = int(ty) - reach; j <= int(ty) + reach + 1; ++j)
    for (int i = int(tx) - reach; i <= int(tx) + reach + 1; ++i)
      if (p.z <= rough(std::clamp(i, 0, kSize - 1), std::clamp(j, 0, kSize - 1))) sum += weight(i - tx) * weight(j - ty);
  return sum;
}

TEST(PercentageCloser, ConstantDepthIsOneComparison) {
  for (const auto pattern : {Percentage::REGULAR, Percentage::POISSON, Percentage::GAUSSIAN})
    for (int size : {1, 2, 4, 7, 16}) {
      const auto V = compare(depthMap(kSize, [](int, int) { return 0.5f; }), unitComparison(kSize, pattern, size),
                             receivers({{0.5f, 0.5f, 0.5f}, {0.01f, 0.99f, 0.4f}, {0.3f, 0.6f, 0.51f}}));
      EXPECT_EQ(V, (std::vector<float>{1, 1, 0})) << int(pattern) << " " << size;
    }
}

TEST(PercentageCloser, GaussianIsTheWeightedSumOfComparisons) {
  const auto points = scattered(600, 200);
  for (int blur : {0, 1, 3, 9}) {
    const auto w = gaussian(blur);
    const auto interpolated = [&](double x) {  // linear between texels, as a bilinear lookup of filtered comparisons is
      const int at = int(std::floor(x));
      const auto of = [&](int k) { return std::abs(k) <= blur ? w[size_t(k + blur)] : 0.0; };
      return of(at) * (1 - (x - at)) + of(at + 1) * (x - at);
    };
    const auto V = compare(depthMap(kSize, rough), unitComparison(kSize, Percentage::GAUSSIAN, blur), receivers(points));
    for (size_t i = 0; i < points.size(); ++i)
      ASSERT_NEAR(V[i], bruteForce(points[i], blur + 1, interpolated), 2e-5) << blur;  // positions round by 2^-19 texels
  }
}

TEST(PercentageCloser, RegularIsTheBoxOfComparisons) {
  // n x n taps with bilinear ends: n - 1 texels of area, those at the rim by their covered part.
  const auto points = scattered(600, 210);
  for (int taps : {2, 3, 4, 8, 16}) {
    const double half = 0.5 * (taps - 1);
    const auto box = [&](double x) { return std::max(0.0, std::min(x + 0.5, half) - std::max(x - 0.5, -half)) / (taps - 1); };
    const auto V = compare(depthMap(kSize, rough), unitComparison(kSize, Percentage::REGULAR, taps), receivers(points));
    for (size_t i = 0; i < points.size(); ++i) ASSERT_NEAR(V[i], bruteForce(points[i], taps, box), 3e-5) << taps;
  }
}

TEST(PercentageCloser, HalfPlaneUnderABoxIsALinearRamp) {
  const int taps = 9;
  std::vector<Vec3> points;
  for (int i = 0; i <= 300; ++i) points.push_back({0.3f + 0.4f * float(i) / 300, 0.5f, 0.6f});
  const auto V = compare(depthMap(64, [](int x, int) { return x < 32 ? 0.3f : 0.7f; }), unitComparison(64, Percentage::REGULAR, taps), receivers(points));
  for (size_t i = 0; i < points.size(); ++i) EXPECT_NEAR(V[i], std::clamp(0.5 + (double(points[i].x) * 64 - 32) / (taps - 1), 0.0, 1.0), 2e-6) << points[i].x;
}

TEST(PercentageCloser, OneTapIsTheHardMap) {
  const auto points = scattered(3000, 220);
  PercentageCloserLookup hard = unitComparison(kSize, Percentage::REGULAR, 1);
  hard.hard = true;
  const auto a = compare(depthMap(kSize, rough), hard, receivers(points)),
             b = compare(depthMap(kSize, rough), unitComparison(kSize, Percentage::REGULAR, 1), receivers(points));
  int compared = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    const auto fraction = [](double t) { return std::fabs(t - std::round(t)); };
    const int x = int(std::floor(texel(points[i].x) + 0.5)), y = int(std::floor(texel(points[i].y) + 0.5));
    EXPECT_EQ(a[i], points[i].z <= rough(x, y) ? 1.0f : 0.0f);
    if (fraction(texel(points[i].x) - 0.5) < 0.001 || fraction(texel(points[i].y) - 0.5) < 0.001) continue;  // on an edge the tap's 0.001 texels see both
    EXPECT_EQ(a[i], b[i]);
    ++compared;
  }
  EXPECT_GT(compared, 2900);
}

TEST(PercentageCloser, KernelsMix) {
  // Linear in the weights: the box of 2 x 2 texels is the mean of its four texels' own.
  const TermPtr depth = depthMap(kSize, rough);
  for (int i = 0; i < 200; ++i) {
    const int x = 3 + int(38 * random01(93, uint64_t(i))), y = 3 + int(38 * random01(94, uint64_t(i)));
    const float z = 0.2f + 0.6f * random01(95, uint64_t(i));
    const auto at = [&](double tx, double ty) { return Vec3(float((tx + 0.5) / kSize), float((ty + 0.5) / kSize), z); };
    PercentageCloserLookup hard = unitComparison(kSize, Percentage::REGULAR, 1);
    hard.hard = true;
    const auto four = compare(depth, hard, receivers({at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)}));
    const auto box = compare(depth, unitComparison(kSize, Percentage::REGULAR, 3), receivers({at(x + 0.5, y + 0.5)}));
    EXPECT_NEAR(box[0], 0.25 * (four[0] + four[1] + four[2] + four[3]), 1e-6);
  }
}

TEST(PercentageCloser, SkippingGivesTheSameBits) {
  // Kernels decided by the pyramid of bounds, on planes of every slope, also where the kernel hangs over the map's rim.
  auto points = scattered(4000, 230);
  for (size_t i = 0; i < points.size(); i += 4) (i % 8 ? points[i].x : points[i].y) = i % 16 < 8 ? 0.01f : 0.99f;
  for (const Vec3& normal : {Vec3(0, 0, -1), glm::normalize(Vec3(0.4f, 0.1f, -1)), glm::normalize(Vec3(-3, 5, -1))})
    for (const auto pattern : {Percentage::REGULAR, Percentage::POISSON, Percentage::GAUSSIAN})
      for (int size : {2, 5, 12}) {
        PercentageCloserLookup l = unitComparison(kSize, pattern, size);
        l.map.slopeBias = 1.0f;
        const TermPtr g = receivers(points, normal);
        const auto with = compare(depthMap(kSize, blocks), l, g);
        l.skip = false;
        const auto without = compare(depthMap(kSize, blocks), l, g);
        int between = 0;
        for (size_t i = 0; i < points.size(); ++i) {
          ASSERT_EQ(with[i], without[i]) << int(pattern) << " " << size << " at " << points[i].x << ", " << points[i].y << ", " << points[i].z;
          between += with[i] > 0 && with[i] < 1;
        }
        EXPECT_GT(between, 100);
      }
}

TEST(PercentageCloser, SkippingKnowsPlanesBeyondTheRim) {
  // A kernel wider than the map: taps beyond both rims repeat its depth, while the receiver's plane goes on past it.
  const int side = 5;
  std::vector<Vec3> points;
  for (int i = 0; i < 2000; ++i) points.push_back({random01(98, uint64_t(i)), random01(99, uint64_t(i)), 0.35f + 0.3f * random01(100, uint64_t(i))});
  const TermPtr g = receivers(points, glm::normalize(Vec3(0.05f, 0.02f, -1)));
  for (const auto pattern : {Percentage::REGULAR, Percentage::GAUSSIAN}) {
    PercentageCloserLookup l = unitComparison(side, pattern, 16);
    l.map.slopeBias = 0.5f;  // 0 would leave the plane flat
    l.skip = false;
    const auto sloped = compare(depthMap(side, [](int, int) { return 0.5f; }), l, g);
    l.skip = true;
    EXPECT_EQ(compare(depthMap(side, [](int, int) { return 0.5f; }), l, g), sloped);
    int between = 0;
    for (float v : sloped) between += v > 0 && v < 1;
    EXPECT_GT(between, 20);
  }
}

TEST(PercentageCloser, PoissonDisksAverageToTheDisk) {
  // One place, many view samples: turned disks of taps^2 points of nearest texels, whose mean is the disk's of radius taps / 2.
  const int taps = 6, n = 4000;
  for (const Vec3& p : {Vec3(0.5f, 0.5f, 0.5f), Vec3(0.31f, 0.68f, 0.4f)}) {
    const auto V = compare(depthMap(kSize, rough), unitComparison(kSize, Percentage::POISSON, taps), receivers(std::vector<Vec3>(n, p)));
    double mean = 0, square = 0, disk = 0;
    for (float v : V) mean += v / n;
    for (float v : V) square += (v - mean) * (v - mean) / n;
    const double tx = texel(p.x), ty = texel(p.y);
    const int fine = 400;
    int inside = 0;
    for (int j = 0; j < fine; ++j)
      for (int i = 0; i < fine; ++i) {
        const double x = (i + 0.5) / fine * taps - taps / 2.0, y = (j + 0.5) / fine * taps - taps / 2.0;
        if (x * x + y * y > taps * taps / 4.0) continue;
        ++inside;
        disk += p.z <= rough(int(std::floor(tx + x + 0.5)), int(std::floor(ty + y + 0.5)));
      }
    EXPECT_NEAR(mean, disk / inside, 0.02);  // rings of equal area, one radius each: their own error; noise of the mean is 0.001
    EXPECT_GT(square, 1e-5) << "disks are turned from sample to sample";
    EXPECT_LT(square, 0.25 / 36) << "more even than 36 independent points";
  }
}

TEST(PercentageCloser, PoissonDisksOfAPartAreThoseOfTheWhole) {
  const int n = 400, from = 130, part = 90, guard = 7;
  const auto points = scattered(n, 240);
  const TermPtr depth = depthMap(kSize, rough);
  PercentageCloserLookup l = unitComparison(kSize, Percentage::POISSON, 5);
  const auto whole = compare(depth, l, receivers(points));
  const auto of = [&](int begin, int end) { return receivers(std::vector<Vec3>(points.begin() + begin, points.begin() + end)); };
  const auto moved = compare(depth, l, of(from, from + part));
  l.place = {from, 0, n, 1};
  const auto window = compare(depth, l, of(from, from + part));
  int others = 0;
  for (int i = 0; i < part; ++i) {
    ASSERT_EQ(window[size_t(i)], whole[size_t(from + i)]) << i;
    others += moved[size_t(i)] != whole[size_t(from + i)];
  }
  EXPECT_GT(others, 5) << "another place would be other disks";
  l.place = {-guard, 0, n - guard, 1};  // more around the picture, which begins at the guard's end
  const auto guarded = compare(depth, l, receivers(points));
  l.place = {};
  const auto plain = compare(depth, l, of(guard, n));
  for (int i = guard; i < n; ++i) ASSERT_EQ(guarded[size_t(i)], plain[size_t(i - guard)]) << i;
}

TEST(PercentageCloser, ReceiverPlaneFollowsTheSurface) {
  // A lit slanted plane: depth of the receiver at every tap is the plane's, so that nothing shadows itself however wide the kernel.
  const float m = 0.012f;
  std::vector<Vec3> points;
  for (int i = 0; i < 300; ++i) {
    const float x = 0.25f + 0.5f * random01(96, uint64_t(i));
    points.push_back({x, 0.2f + 0.6f * random01(97, uint64_t(i)), 0.1f + m * (x * kSize - 0.5f)});
  }
  const TermPtr depth = depthMap(kSize, [&](int x, int) { return 0.1f + m * float(x); }), g = receivers(points, glm::normalize(Vec3(m * kSize, 0, -1)));
  for (const auto pattern : {Percentage::REGULAR, Percentage::POISSON, Percentage::GAUSSIAN}) {
    PercentageCloserLookup l = unitComparison(kSize, pattern, 9);
    l.map.slopeBias = 1.0f;
    for (float v : compare(depth, l, g)) EXPECT_EQ(v, 1.0f) << int(pattern);
    l.map.slopeBias = 0.0f;
    double mean = 0;
    for (float v : compare(depth, l, g)) mean += v / 300;
    EXPECT_LT(mean, 0.7) << "without the plane half of the kernel is in front";
  }
}

}  // namespace

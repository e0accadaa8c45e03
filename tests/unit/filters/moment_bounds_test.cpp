// SPDX-License-Identifier: Apache-2.0
// Bounds from moments: variance (Donnelly & Lauritzen 2006), exponential variance (Lauritzen & McCool 2008), four moments (Peters & Klein 2015).
// Where they are tight, where they bleed and by how much, and what rounding makes of them.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "filters/parameter.h"
#include "unit/filters/shadow_map_cases.h"

namespace {

using namespace gobo;
using namespace gobo::shadowtest;

ShadowBasisPtr variance(double cut = 0, double floor = 1e-7) {
  v1::VarianceShadow m;
  m.set_bleeding_reduction(cut);
  m.set_min_variance(floor);
  return makeVarianceBasis(m);
}
ShadowBasisPtr moments(double cut = 0, double bias = 3e-6) {
  v1::MomentShadow m;
  m.set_bleeding_reduction(cut);
  m.set_moment_bias(bias);
  return makeMomentBasis(m);
}

struct Point {
  double z, share;
};
using Distribution = std::vector<Point>;

/// What the shipped code says of a kernel over the distribution: float encode, float weighted sum, float reconstruction.
float shipped(const ShadowBasis& b, const Distribution& points, double d) {
  const size_t C = size_t(b.channels());
  std::vector<float> sum(C, 0.0f), v(C);
  for (const Point& p : points) {
    const float z = float(p.z);
    b.encode(&z, v.data(), 1);
    for (size_t k = 0; k < C; ++k) sum[k] += float(p.share) * v[k];
  }
  const float df = float(d);
  float s;
  b.reconstruct(sum.data(), 1, &df, &s, 1);
  return s;
}
/// Share of the kernel at or behind d.
double truth(const Distribution& points, double d) {
  double lit = 0;
  for (const Point& p : points) lit += p.z >= d ? p.share : 0;
  return lit;
}
double chebyshev(const Distribution& points, double d, double floor = 0) {
  double mean = 0, square = 0;
  for (const Point& p : points) mean += p.share * p.z;
  for (const Point& p : points) square += p.share * (p.z - mean) * (p.z - mean);
  square = std::max(square, floor);
  return d <= mean ? 1 : square / (square + (d - mean) * (d - mean));
}
Distribution randomDistribution(uint64_t seed, int count) {
  Distribution points;
  double sum = 0;
  for (int i = 0; i < count; ++i) points.push_back({0.02 + 0.96 * random01(seed, uint64_t(2 * i)), 0.05 + double(random01(seed, uint64_t(2 * i + 1)))});
  for (const Point& p : points) sum += p.share;
  for (Point& p : points) p.share /= sum;
  return points;
}

TEST(VarianceShadow, ExactForOneBlockerPlaneOverAParallelReceiver) {
  for (double p : {0.02, 0.3, 0.5, 0.9, 0.99})
    for (const auto& [z, d] : {std::pair{0.1, 0.9}, {0.4, 0.5}, {0.9, 0.99}, {0.0, 1.0}}) {
      const double gap = d - z;
      // Moments of rounding 2^-26 each, over the variance p (1 - p) gap^2.
      EXPECT_NEAR(shipped(*variance(), {{z, 1 - p}, {float(d), p}}, d), p, 1e-5 + 1e-7 / (gap * gap)) << p << " " << z << " " << d;
    }
  // Through the nodes: a half plane under the pre-filter is its ramp. The receiver's plane is the background's.
  const int size = 64, blur = 4;
  const auto w = gaussian(blur);
  std::vector<Vec3> points;
  for (int i = 0; i <= 200; ++i) points.push_back({0.3f + 0.4f * float(i) / 200, 0.5f, 0.75f});
  const auto V = visibility(depthMap(size, [&](int x, int) { return x < size / 2 ? 0.25f : 0.75f; }), variance(), blur, points);
  for (size_t i = 0; i < points.size(); ++i) {
    const double t = double(points[i].x) * size - 0.5;
    const int x = int(t);
    const auto share = [&](int at) {
      double p = 0;
      for (int k = -blur; k <= blur; ++k) p += at + k >= size / 2 ? w[size_t(k + blur)] : 0;
      return p;
    };
    EXPECT_NEAR(V[i], share(x) * (1 - (t - x)) + share(x + 1) * (t - x), 2e-5) << points[i].x;
  }
}

TEST(VarianceShadow, ThreePlanesBleedByThePredictedAmount) {
  // Two blockers over a receiver that lies behind both: truth 0, the bound s = var / (var + (d - mean)^2). For shares 1/2 at 0.2 and 0.7 under
  // d = 0.8: mean 0.45, var 0.0625, s = 0.0625 / 0.185 = 0.3378.
  const Distribution two{{0.2, 0.5}, {0.7, 0.5}};
  EXPECT_NEAR(shipped(*variance(), two, 0.8), 0.33784, 2e-5);
  EXPECT_EQ(truth(two, 0.8), 0);
  EXPECT_NEAR(shipped(*variance(0.2), two, 0.8), (0.33784 - 0.2) / 0.8, 3e-5);  // reduction: below the cut dark, the rest stretched
  EXPECT_EQ(shipped(*variance(0.34), two, 0.8), 0.0f);
  for (uint64_t seed = 0; seed < 400; ++seed) {
    const Distribution points = randomDistribution(100 + seed, 2 + int(seed % 5));
    const double d = random01(99, seed);
    const double s = shipped(*variance(), points, d);
    EXPECT_NEAR(s, chebyshev(points, float(d), 1e-7), 5e-5) << seed;
    EXPECT_GE(s, truth(points, d) - 5e-5) << "Chebyshev is an upper bound";
  }
}

TEST(VarianceShadow, MomentsAboutTheMiddleKeepSmallVariances) {
  // Depth range 1:1000 or more: two surfaces 1/1000 of it apart, anywhere in it. m2 - m1^2 of z would lose 2^-24 z^2, up to 6e-8 a rounding; of
  // z - 1/2 a quarter. The variance here is 2.5e-7 at most. Bounds fail without the shift (worst 0.13 then, rms 0.03).
  double worst = 0, square = 0;
  int count = 0;
  for (int i = 0; i <= 1000; ++i) {
    const double z = 0.9985 * i / 1000, gap = 0.001;
    const float zf = float(z), df = float(z + gap);
    for (double p : {0.25, 0.5, 0.75}) {
      const Distribution points{{zf, 1 - p}, {df, p}};
      const double error = std::fabs(shipped(*variance(0, 1e-8), points, df) - chebyshev(points, df));
      worst = std::max(worst, error);
      square += error * error;
      ++count;
    }
  }
  const double rms = std::sqrt(square / count);
  std::cout << "gap of 1/1000: visibility off by rms " << rms << ", at most " << worst << std::endl;
  EXPECT_LT(rms, 0.016);
  EXPECT_LT(worst, 0.08);
}

TEST(VarianceShadow, SmallestVarianceLightsWhatLiesWithinRounding) {
  // A flat lit surface whose receivers lie up to 1e-5 behind their texel: without the floor the variance of equal depths is rounding, and the
  // surface black.
  for (int i = 0; i < 200; ++i) {
    const float z = 0.99f * random01(71, uint64_t(i));
    for (float behind : {1e-7f, 1e-6f, 1e-5f}) {
      EXPECT_GT(shipped(*variance(0, 1e-7), {{z, 0.3}, {z, 0.3}, {z, 0.4}}, double(z) + double(behind)), 0.99f) << z << " " << behind;
      EXPECT_GT(shipped(*makeExponentialVarianceBasis(40, 10, 1e-6f, 0), {{z, 0.3}, {z, 0.3}, {z, 0.4}}, double(z) + double(behind)), 0.99f)
          << z << " " << behind;
    }
    EXPECT_LT(shipped(*variance(0, 1e-7), {{z, 1.0}}, double(z) + 0.01), 0.01f);  // and what lies well behind is dark
  }
}

TEST(ExponentialVarianceShadow, HoldsAtTheNearPlaneForTheLargestExponents) {
  // There e^{c (z - 1)} is 1e-18 and its square 3e-37: variances and gaps of such squares must not vanish. A lit surface at the near plane, its
  // receivers within the least variance of it; and a pair of planes there, half and half.
  for (float c : {10.0f, 40.0f, 42.0f})
    for (double z : {0.0, 0.001, 0.02, 0.5, 0.97}) {
      const ShadowBasisPtr basis = makeExponentialVarianceBasis(c, 10, 1e-6f, 0);
      EXPECT_GT(shipped(*basis, {{z, 1.0}}, z + 2e-5), 0.99f) << c << " " << z;
      EXPECT_LT(shipped(*basis, {{z, 1.0}}, z + 0.02), 0.01f) << c << " " << z;
      const double d = float(z + 0.03);
      EXPECT_NEAR(shipped(*basis, {{z, 0.5}, {d, 0.5}}, d), 0.5, 0.01) << c << " " << z;
    }
}

TEST(ExponentialVarianceShadow, BleedsLessThanVarianceOnThreePlanes) {
  // Receivers behind two blockers. The positive warp shrinks the variance: predicted by Chebyshev of the warped planes.
  const Distribution two{{0.2, 0.5}, {0.7, 0.5}};
  const double c = 40, a = std::exp(c * (0.2 - 1)), b = std::exp(c * (0.7 - 1)), t = std::exp(c * (0.8 - 1));
  // The least variance, 1e-6 depth ranges squared, is (c t)^2 times that in the warp: what remains of bleeding here.
  const double mean = 0.5 * (a + b), var = std::max(0.25 * (b - a) * (b - a), 1e-6 * c * c * t * t), predicted = var / (var + (t - mean) * (t - mean));
  const ShadowBasisPtr basis = makeExponentialVarianceBasis(float(c), 10, 1e-6f, 0);
  EXPECT_NEAR(shipped(*basis, two, 0.8), predicted, 1e-6);
  EXPECT_LT(predicted, 0.002);  // variance: 0.338
  // What it gives up: just behind the front blocker with the back one shortly behind the receiver. Both bounds hold, the smaller is taken.
  for (uint64_t seed = 0; seed < 300; ++seed) {
    const Distribution points = randomDistribution(300 + seed, 2 + int(seed % 4));
    const double d = random01(98, seed), s = shipped(*basis, points, d);
    EXPECT_GE(s, truth(points, d) - 1e-4) << seed;
    EXPECT_LE(s, 1.0);
  }
}

TEST(MomentShadow, ExactWhereTheKernelHoldsTwoDepths) {
  // Four moments fix a distribution on two points (and one on three of which the receiver's depth is one): the bound is tight. The bias
  // b of uniform moments costs O(sqrt(b)) nearby, less with the gap.
  for (double p : {0.1, 0.5, 0.9})
    for (const auto& [z, d] : {std::pair{0.1, 0.9}, {0.3, 0.6}, {0.6, 0.8}}) {
      EXPECT_NEAR(shipped(*moments(), {{z, 1 - p}, {d, p}}, d), p, 4e-3) << p << " " << z << " " << d;
      EXPECT_LT(shipped(*moments(), {{z, 1 - p}, {d, p}}, 0.5 * (z + d)), p + 4e-3) << "between them";
      EXPECT_GT(shipped(*moments(), {{z, 1 - p}, {d, p}}, 0.5 * (z + d)), p - 4e-3);
      EXPECT_LT(shipped(*moments(), {{z, 1 - p}, {d, p}}, d + 0.1), 0.01) << "behind both";
      EXPECT_GT(shipped(*moments(), {{z, 1 - p}, {d, p}}, z - 0.05), 0.99) << "before both";
    }
  EXPECT_NEAR(shipped(*moments(), {{0.2, 0.5}, {0.7, 0.2}, {0.9, 0.3}}, 0.9), 0.3, 0.01);  // three, the receiver's among them
}

TEST(MomentShadow, BleedsLessThanVariance) {
  EXPECT_LT(shipped(*moments(), {{0.2, 0.5}, {0.7, 0.5}}, 0.8), 0.01);  // variance: 0.338
  // Everywhere: the bound from four moments is never above that from two (but for the bias), and above the truth.
  double here = 0, there = 0;
  for (uint64_t seed = 0; seed < 2000; ++seed) {
    const Distribution points = randomDistribution(500 + seed, 1 + int(seed % 6));
    const double d = random01(97, seed), s = shipped(*moments(), points, d), v = chebyshev(points, d, 1e-7);
    ASSERT_TRUE(s >= 0 && s <= 1) << seed;
    EXPECT_LE(s, v + 0.01) << seed;
    EXPECT_GE(s, truth(points, d) - 0.02) << seed;
    here += s - truth(points, d);
    there += v - truth(points, d);
  }
  std::cout << "mean excess over the truth: four moments " << here / 2000 << ", variance " << there / 2000 << std::endl;
  EXPECT_LT(here, 0.7 * there);
}

TEST(MomentShadow, RoundingLeavesTheMatrixUsable) {
  // One depth under the whole kernel: the Hankel matrix has rank 1, its pivots are rounding. The surface must stay lit before its texel, within
  // a bias behind it, and dark well behind it, for every depth; and no result may leave [0,1].
  for (int i = 0; i <= 2000; ++i) {
    const double z = float(i / 2000.0);
    for (double spread : {0.0, 1e-7, 1e-5, 1e-3}) {
      const Distribution points{{z, 0.2}, {std::min(1.0, z + spread), 0.5}, {std::max(0.0, z - spread), 0.3}};
      for (double gap : {-0.5, -0.1, -0.02, 0.02, 0.1, 0.5}) {
        if (z + gap < 0 || z + gap > 1) continue;
        const float s = shipped(*moments(), points, z + gap);
        ASSERT_TRUE(s >= 0.0f && s <= 1.0f) << z << " " << spread << " " << s;
        if (gap < 0) {
          EXPECT_GT(s, 0.98f) << z << " " << spread << " " << gap;
        } else {
          EXPECT_LT(s, 0.05f) << z << " " << spread << " " << gap;
        }
      }
    }
  }
}

// The choice of the default bias. Surfaces of every tilt, with float noise in their depths, under a 5 x 5 kernel in float: a bias below 1e-6 leaves
// the matrix to rounding and the lit surface gets black specks; above it costs sharpness between close planes only. The default is three
// times the smallest clean one.
TEST(MomentShadow, DefaultBiasIsTheSmallestThatRoundingLeavesClean) {
  struct Cost {
    double speck = 0, mean = 0, planes[3] = {0, 0, 0};
  };
  const double gaps[3] = {0.01, 0.03, 0.1};
  const auto cost = [&](double bias) {
    const auto basis = moments(0, bias);
    const std::vector<float> w = shadowGaussian(2);
    Cost c;
    const int n = 12000;
    for (int i = 0; i < n; ++i) {
      const auto r = [&](uint64_t k) { return double(random01(k, uint64_t(i))); };
      const double z = 0.02 + 0.95 * r(81), tilt = (i % 4 == 0 ? 0.0 : i % 4 == 1 ? 1e-6 : i % 4 == 2 ? 1e-4 : 2e-3) * r(82), noise = (i % 3) * 3e-7;
      const double d = z - 0.0005;  // the default depth bias
      float sum[4] = {};
      double lit = 0;
      for (int y = 0; y < 5; ++y) {
        float row[4] = {};
        for (int x = 0; x < 5; ++x) {
          const float at = float(z + tilt * (x - 2) + 0.5 * tilt * (y - 2) + noise * (random01(200 + uint64_t(x + 5 * y), uint64_t(i)) - 0.5));
          float v[4];
          basis->encode(&at, v, 1);
          for (int k = 0; k < 4; ++k) row[k] += w[size_t(x)] * v[k];
          lit += at >= d ? double(w[size_t(x)] * w[size_t(y)]) : 0;
        }
        for (int k = 0; k < 4; ++k) sum[k] += w[size_t(y)] * row[k];
      }
      const float df = float(d);
      float s;
      basis->reconstruct(sum, 1, &df, &s, 1);
      c.speck = std::max(c.speck, lit - s);
      c.mean += std::max(0.0, lit - s) / n;
      const int g = i % 3;
      const double p = r(83), front = 0.02 + (0.95 - gaps[g]) * r(84);
      c.planes[g] += std::fabs(shipped(*basis, {{front, 1 - p}, {front + gaps[g], p}}, front + gaps[g] - 0.0005) - p) * 3 / n;
    }
    return c;
  };
  std::map<double, Cost> costs;
  for (double bias : {3e-8, 1e-7, 3e-7, 1e-6, 3e-6, 1e-5, 3e-5}) {
    const Cost c = costs[bias] = cost(bias);
    std::cout << "moment bias " << bias << ": lit surface too dark by " << c.mean << ", at most " << c.speck
              << "; receiver on the far of two planes 0.01, 0.03, 0.1 apart off by " << c.planes[0] << ", " << c.planes[1] << ", " << c.planes[2] << std::endl;
  }
  const double standard = numberParameter(v1::MomentShadow(), "moment_bias");
  EXPECT_LT(cost(standard).speck, 1e-3);
  EXPECT_LT(costs[1e-6].speck, 1e-3);
  EXPECT_GT(costs[1e-7].speck, 0.1) << "the sweep does not see what the bias is for";
  for (int g = 0; g < 3; ++g) EXPECT_LT(cost(standard).planes[g], 1.2 * costs[1e-6].planes[g] + 0.002);
}

}  // namespace

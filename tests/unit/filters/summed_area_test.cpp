// SPDX-License-Identifier: Apache-2.0
// Integer summed-area tables against sums in double: exact but for the rounding of texels, for boxes of every size, place and fraction.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "filters/shadow_map/summed_area.h"
#include "unit/filters/shadow_map_cases.h"

namespace {

using namespace gobo;
using namespace gobo::shadowtest;

constexpr double kStep = 1.0 / 65536;  // half of 1/32767 and a little: what rounding a texel may cost
const double kBound = kStep + 1e-6;    // and the float result's own rounding

TermPtr tableOf(const TermPtr& map, const ShadowBasisPtr& basis, int threads = 2) {
  return runNode(makeShadowSummedAreaNode(basis, map->extent().width, map->extent().layers), {map}, threads);
}

struct Box {
  double x0, x1, y0, y1;
};
/// The box that SummedArea::box takes: at least a texel, cut at the map's rim; floats as there.
Box boxOf(int side, float x, float y, float width, float height) {
  const auto span = [&](float at, float size, double& lo, double& hi) {
    const float c = std::clamp(at + 0.5f, 0.5f, float(side) - 0.5f), half = 0.5f * std::max(size, 1.0f);
    lo = std::max(c - half, 0.0f);
    hi = std::min(c + half, float(side));
  };
  Box b;
  span(x, width, b.x0, b.x1);
  span(y, height, b.y0, b.y1);
  return b;
}
template <typename Value>
double mean(const Box& b, const Value& value) {
  double sum = 0;
  for (int y = int(b.y0); y < b.y1; ++y) {
    const double wy = std::min(b.y1, y + 1.0) - std::max(b.y0, double(y));
    double row = 0;
    for (int x = int(b.x0); x < b.x1; ++x) row += (std::min(b.x1, x + 1.0) - std::max(b.x0, double(x))) * double(value(x, y));
    sum += wy * row;
  }
  return sum / ((b.x1 - b.x0) * (b.y1 - b.y0));
}

TEST(SummedArea, BoxesOfEverySizeAreExactButForTexelRounding) {
  const ShadowBasisPtr basis = makeVarianceBasis({});
  for (int side : {1, 2, 7, 8, 9, 16, 61, 300, 700}) {
    const auto value = [](int x, int y, int k) { return k == 0 ? 2 * random01(121, uint64_t(y * 9999 + x)) - 1 : (x / 50 + y / 50) % 2 ? 1.0f : -0.999f; };
    const TermPtr table = tableOf(basisMap(side, 2, value), basis);
    const SummedArea sums(*table, side);
    const int cases = side < 100 ? 300 : 60;
    double worst = 0;
    for (int i = 0; i < cases; ++i) {
      const auto r = [&](uint64_t s) { return random01(122 + s, uint64_t(i)); };
      // Whole texels, fractions, slivers, and boxes that hang over the rim or hold the whole map.
      const float x = float(side) * (1.4f * r(0) - 0.2f), y = float(side) * (1.4f * r(1) - 0.2f);
      const float width = i % 5 == 0 ? float(1 + int(r(2) * 20)) : 1.6f * float(side) * r(2) * r(4),
                  height = i % 7 == 0 ? 1.0f : 1.6f * float(side) * r(3) * r(4);
      float out[2], second;
      sums.box(0, x, y, width, height, out);
      const Box b = boxOf(side, x, y, width, height);
      for (int k = 0; k < 2; ++k) {
        const double error = std::fabs(out[k] - mean(b, [&](int px, int py) { return value(px, py, k); }));
        worst = std::max(worst, error);
        ASSERT_LE(error, kBound) << side << ": " << b.x0 << ".." << b.x1 << " x " << b.y0 << ".." << b.y1;
      }
      sums.box(0, x, y, width, height, 1, 2, &second);  // one channel alone
      ASSERT_EQ(second, out[1]);
    }
    if (side == 700) std::cout << "700 texels a side: worst error " << worst << std::endl;
  }
}

TEST(SummedArea, RandomTexelsAverageTheirRoundingAway) {
  // The worst case above is constant texels between two steps. On others a box of n texels errs by 2^-16 / sqrt(3 n).
  const ShadowBasisPtr basis = makeVarianceBasis({});
  const int side = 256;
  const auto value = [](int x, int y, int) { return 2 * random01(131, uint64_t(y * 9999 + x)) - 1; };
  const TermPtr table = tableOf(basisMap(side, 2, value), basis);
  const SummedArea sums(*table, side);
  for (int n : {3, 9, 33}) {
    double square = 0;
    for (int i = 0; i < 200; ++i) {
      const float x = float(20 + int(200 * random01(132, uint64_t(i)))), y = float(20 + int(200 * random01(133, uint64_t(i))));
      float out[2];
      sums.box(0, x, y, float(n), float(n), out);
      square += std::pow(out[0] - mean(boxOf(side, x, y, float(n), float(n)), [&](int px, int py) { return value(px, py, 0); }), 2);
    }
    EXPECT_LT(std::sqrt(square / 200), 2 * kStep / std::sqrt(3.0) / n + 3e-8) << n;
  }
}

TEST(SummedArea, LargestMapsHoldTheirBound) {
  // 4096 x 4096 texels (float32 tables err by 6e-3 rms there, up to 0.057; digest 7.8): boxes from a texel to the map, below 1e-4 each. One channel
  // at its extreme, +1 everywhere: the largest sums of all.
  const int side = 4096;
  const ShadowBasisPtr basis = makeVarianceBasis({});
  const auto value = [](int x, int y, int k) {
    return k ? 1.0f : float(int((unsigned(x) * 2654435761u + unsigned(y) * 40503u) >> 16 & 0xffff)) / 32767.5f - 1.0f;
  };
  const TermPtr table = tableOf(basisMap(side, 2, value), basis);
  EXPECT_LE(table->planes()[0].bytes.size(), size_t(side) * side * 2 * 4 * 65 / 64);  // the stated bound
  EXPECT_EQ(table->planes()[0].bytes.size(), SummedArea::extent(side, 1).elements() * size_t(basis->channels()) * 4);
  const SummedArea sums(*table, side);
  double worst = 0;
  for (int i = 0; i < 40; ++i) {
    const auto r = [&](uint64_t s) { return random01(141 + s, uint64_t(i)); };
    const float size = std::exp2(12.0f * float(i) / 39), x = side * r(0), y = side * r(1), height = i % 4 ? size : 3.0f;
    float out[2];
    sums.box(0, x, y, size, height, out);
    const Box b = boxOf(side, x, y, size, height);
    worst = std::max(worst, std::fabs(out[0] - mean(b, [&](int px, int py) { return value(px, py, 0); })));
    ASSERT_NEAR(out[1], 1.0, kBound) << size;
  }
  std::cout << "4096 texels a side: worst error " << worst << std::endl;
  EXPECT_LT(worst, 1e-4);
  EXPECT_LE(worst, kBound);
}

TEST(SummedArea, DamagedTexelsCountAsZeroAndDoNotSpread) {
  const ShadowBasisPtr basis = makeVarianceBasis({});
  for (float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(), 1e30f}) {
    const int side = 20;
    const TermPtr table = tableOf(basisMap(side, 2, [&](int x, int y, int) { return x == 5 && y == 5 ? bad : 0.25f; }), basis);
    const SummedArea sums(*table, side);
    float out[2];
    sums.box(0, 12, 12, 5, 5, out);
    EXPECT_NEAR(out[0], 0.25, kBound) << bad;
    sums.box(0, 5, 5, 3, 3, out);
    EXPECT_TRUE(out[0] >= 0.2f && out[0] <= 0.35f) << bad;  // out of range is cut to [-1, 1]
  }
}

TEST(SummedArea, FacesAreApart) {
  const ShadowBasisPtr basis = makeVarianceBasis({});
  const int side = 19, faces = 6;
  auto map = std::make_shared<Term>("shadow_basis", Domain::LightTexel, Extent{side, side, faces});
  auto B = map->addPlane<float>("B", 2);
  for (size_t i = 0; i < B.size(); ++i) B[i] = float(i / (size_t(side) * side * 2)) / 8;
  const TermPtr table = tableOf(map, basis);
  const SummedArea sums(*table, side);
  for (int f = 0; f < faces; ++f) {
    float out[2];
    sums.box(f, 7.3f, 9.1f, 6.5f, 4.0f, out);
    EXPECT_NEAR(out[0], f / 8.0, kBound);
  }
}

TEST(SummedArea, SameBitsForAnyNumberOfThreads) {
  const ShadowBasisPtr basis = makeVarianceBasis({});
  const TermPtr map = basisMap(333, 2, [](int x, int y, int k) { return 2 * random01(151, uint64_t(y * 9999 + x * 2 + k)) - 1; });
  EXPECT_EQ(tableOf(map, basis, 1)->content(), tableOf(map, basis, 7)->content());
}

TEST(SummedArea, NodeLooksUpTheFootprintsBox) {
  // Through the lookup node: variance of a half plane under a face-on pixel 9 texels wide is the share of its box.
  const int side = 64;
  v1::VarianceShadow m;
  m.set_bleeding_reduction(0);
  const ShadowBasisPtr basis = makeVarianceBasis(m);
  const TermPtr table = tableOf(encodeBasis(depthMap(side, [](int x, int) { return x < 32 ? 0.25f : 0.75f; }), basis, 0), basis);
  std::vector<Vec3> points;
  for (int i = 0; i <= 100; ++i) points.push_back({0.3f + 0.4f * float(i) / 100, 0.5f, 0.75f});
  ShadowLookup l = unitLookup(side);
  l.map.lookup = v1::ShadowMapSettings::SUMMED_AREA;
  const auto V = values(lookupBasis(receivers(points, Vec3(0, 0, -1), 9.0f / side), table, basis, l), "V");
  for (size_t i = 0; i < points.size(); ++i) EXPECT_NEAR(V[i], std::clamp(0.5 + (double(points[i].x) * side - 32) / 9, 0.0, 1.0), 5e-4) << points[i].x;
}

TEST(SummedAreaDeathTest, UnboundedBasesAreProgrammerErrors) {
  EXPECT_DEATH(makeShadowSummedAreaNode(makeExponentialBasis(40, false), 64, 1), "CHECK failed");
  EXPECT_DEATH(makeShadowSummedAreaNode(makeVarianceBasis({}), 8193, 1), "CHECK failed");
}

}  // namespace

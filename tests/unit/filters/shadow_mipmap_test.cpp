// SPDX-License-Identifier: Apache-2.0
// Chains of levels of filtered maps and their trilinear and anisotropic lookups, against means in double.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "filters/shadow_map/depth_bounds.h"
#include "filters/shadow_map/shadow_texture.h"
#include "unit/filters/shadow_map_cases.h"

namespace {

using namespace gobo;
using namespace gobo::shadowtest;
using Settings = v1::ShadowMapSettings;

v1::ConvolutionShadow order(uint32_t m) {
  v1::ConvolutionShadow c;
  c.set_order(m);
  return c;
}
TermPtr chainOf(const TermPtr& map, const ShadowBasisPtr& basis, int side, bool bytes = false) {
  return runNode(makeShadowMipmapNode(basis, side, 1, bytes), {map});
}

/// Level l in double: a texel is the area mean of level 0 over its share of the map, level by level.
std::vector<double> below(const std::vector<double>& a, int from) {
  const int to = (from + 1) / 2;
  const double ratio = double(from) / to;
  std::vector<double> out(size_t(to) * size_t(to), 0.0);
  const auto share = [&](int i, int t) { return std::max(0.0, std::min((t + 1) * ratio, i + 1.0) - std::max(t * ratio, double(i))) / ratio; };
  for (int y = 0; y < to; ++y)
    for (int x = 0; x < to; ++x)
      for (int j = 0; j < from; ++j)
        for (int i = 0; i < from; ++i)
          if (const double w = share(i, x) * share(j, y); w > 0) out[size_t(y) * size_t(to) + size_t(x)] += w * a[size_t(j) * size_t(from) + size_t(i)];
  return out;
}

TEST(ShadowMipmap, EveryLevelIsTheMeanOfWhatItCovers) {
  for (int side : {1, 2, 3, 5, 8, 13, 31, 33}) {
    const ShadowBasisPtr basis = makeConvolutionBasis(order(2));
    const TermPtr map = encodeBasis(depthMap(side, [](int x, int y) { return random01(101, uint64_t(y * 99 + x)); }), basis, 0);
    const TermPtr chain = chainOf(map, basis, side);
    const auto B = map->floats("B"), all = chain->floats("B");
    ASSERT_EQ(all.size(), mipTexels(side) * 4);
    for (size_t k = 0; k < 4; ++k) {
      std::vector<double> level(size_t(side) * size_t(side));
      double mean = 0;
      for (size_t t = 0; t < level.size(); ++t) mean += (level[t] = B[t * 4 + k]) / double(level.size());
      for (int l = 0, s = side; l < mipLevels(side); ++l) {
        const MipLevel m = mipLevel(side, l);
        ASSERT_EQ(m.side, s);
        double here = 0;
        for (size_t t = 0; t < level.size(); ++t) {
          ASSERT_NEAR(all[(m.offset + t) * 4 + k], level[t], 1e-6) << side << " level " << l;
          here += all[(m.offset + t) * 4 + k] / double(level.size());
        }
        EXPECT_NEAR(here, mean, 1e-6) << "the mean of level " << l << " of " << side << " texels";  // sides of any length lose nothing
        if (s > 1) level = below(level, s);
        s = (s + 1) / 2;
      }
    }
  }
}

TEST(ShadowMipmap, ConstantMapsAreConstantEverywhere) {
  std::vector<Vec3> points;
  for (int i = 0; i < 200; ++i) points.push_back({random01(102, uint64_t(i)), random01(103, uint64_t(i)), 0.5f});
  for (const ShadowBasisPtr& basis : {makeExponentialBasis(80, false), makeExponentialBasis(300, true), makeVarianceBasis({}), makeConvolutionBasis(order(8)),
                                      makeMomentBasis({}), makeExponentialVarianceBasis(40, 10, 1e-6f, 0)})
    for (int side : {1, 37, 64}) {
      const TermPtr depth = depthMap(side, [](int, int) { return 0.47f; });
      const float expected = visibility(depth, basis, 0, {{0.5f, 0.5f, 0.5f}})[0];
      const TermPtr chain = chainOf(encodeBasis(depth, basis, 2), basis, side);
      for (const auto lookup : {Settings::TRILINEAR, Settings::ANISOTROPIC})
        for (float footprint : {0.001f, 0.07f, 0.5f, 30.0f})
          for (const Vec3& normal : {Vec3(0, 0, -1), glm::normalize(Vec3(4, 2, -1))}) {
            ShadowLookup l = unitLookup(side, 2);
            l.map.lookup = lookup;
            for (float v : values(lookupBasis(receivers(points, normal, footprint), chain, basis, l), "V"))
              ASSERT_NEAR(v, expected, 2e-3) << basis->name() << " " << side;
          }
    }
}

TEST(ShadowMipmap, BytesLoseHalfAStepALevel) {
  const int side = 40;
  const ShadowBasisPtr basis = makeConvolutionBasis(order(4));
  const TermPtr depth = depthMap(side, [](int x, int y) { return random01(104, uint64_t(y * 99 + x)); });
  const TermPtr floats = chainOf(encodeBasis(depth, basis, 1), basis, side), bytes = chainOf(encodeBasis(depth, basis, 1, true), basis, side, true);
  const auto f = floats->floats("B");
  const auto b = bytes->plane<uint8_t>("B");
  for (int l = 0; l < mipLevels(side); ++l) {
    const MipLevel m = mipLevel(side, l);
    for (size_t i = m.offset * 8; i < (m.offset + size_t(m.side) * size_t(m.side)) * 8; ++i)
      ASSERT_LE(std::fabs(formulas::csmFromByte(float(b[i])) - f[i]), 0.5 * (l + 1) / 127 + 1e-6) << l;
  }
}

/// Depth of texel means for lookups of single values: a one-channel map.
TermPtr ramp(int side) {
  return basisMap(side, 1, [](int x, int y, int) { return 0.1f * random01(105, uint64_t(y * 999 + x)) + (x < 30 ? 0.2f : 0.7f); });
}

TEST(ShadowMipmap, TrilinearInterpolatesPlacesAndLevels) {
  const int side = 64;
  const ShadowBasisPtr basis = makeExponentialBasis(10, false);  // any basis of one channel; only its filter is used
  const TermPtr chain = chainOf(ramp(side), basis, side);
  const ShadowTexture texture(*chain, side);
  const auto all = chain->floats("B");
  const auto level = [&](double x, double y, int l) {  // bilinear in double at texels of level 0
    const MipLevel m = mipLevel(side, l);
    const double u = std::clamp((x + 0.5) * m.side / side - 0.5, 0.0, m.side - 1.0), v = std::clamp((y + 0.5) * m.side / side - 0.5, 0.0, m.side - 1.0);
    const int i = int(u), j = int(v);
    const auto at = [&](int a, int b) { return double(all[m.offset + size_t(std::min(b, m.side - 1)) * size_t(m.side) + size_t(std::min(a, m.side - 1))]); };
    return (at(i, j) * (1 - (u - i)) + at(i + 1, j) * (u - i)) * (1 - (v - j)) + (at(i, j + 1) * (1 - (u - i)) + at(i + 1, j + 1) * (u - i)) * (v - j);
  };
  for (int i = 0; i < 500; ++i) {
    const float x = 63 * random01(106, uint64_t(i)), y = 63 * random01(107, uint64_t(i)), l = 8 * random01(108, uint64_t(i)) - 1;
    float out;
    texture.trilinear(0, x, y, l, &out);
    const double c = std::clamp(double(l), 0.0, double(mipLevels(side) - 1));
    const int low = int(c);
    const double exact = level(x, y, low) * (1 - (c - low)) + level(x, y, std::min(low + 1, mipLevels(side) - 1)) * (c - low);
    ASSERT_NEAR(out, exact, 2e-6) << l;
  }
}

TEST(ShadowMipmap, AnisotropicLookupsAverageTheFootprint) {
  // Across a step, elongated footprints along and across it, against the mean over the parallelogram itself. Trilinear taps reach further
  // than the footprint's half width: the error is bounded, below that of the isotropic lookup, and vanishes along the step.
  const int side = 256;
  const ShadowBasisPtr basis = makeExponentialBasis(10, false);
  const TermPtr chain = chainOf(basisMap(side, 1, [](int x, int, int) { return x < 128 ? 0.0f : 1.0f; }), basis, side);
  const ShadowTexture texture(*chain, side);
  double aniso = 0, iso = 0;
  int n = 0;
  for (double length : {8.0, 20.0, 32.0})
    for (double angle : {0.0, 0.5, 1.2, M_PI / 2}) {
      const Vec2 major(float(length * std::cos(angle)), float(length * std::sin(angle))), minor(float(-2 * std::sin(angle)), float(2 * std::cos(angle)));
      for (int i = 0; i < 40; ++i) {
        const float x = 100 + 56 * random01(109, uint64_t(i)), y = 128 + 20 * random01(110, uint64_t(i));
        double exact = 0;
        for (int b = 0; b < 20; ++b)
          for (int a = 0; a < 200; ++a) exact += double(x) + ((a + 0.5) / 200 - 0.5) * major.x + ((b + 0.5) / 20 - 0.5) * minor.x >= 127.5 ? 1.0 / 4000 : 0.0;
        float out, round;
        texture.anisotropic(0, x, y, major, minor, 16, &out);
        texture.trilinear(0, x, y, std::log2(float(length)), &round);
        aniso += (out - exact) * (out - exact);
        iso += (round - exact) * (round - exact);
        ++n;
        EXPECT_NEAR(out, exact, 0.05);
      }
    }
  std::cout << "footprints across a step: anisotropic rms " << std::sqrt(aniso / n) << ", isotropic " << std::sqrt(iso / n) << std::endl;
  EXPECT_LT(std::sqrt(aniso / n), 0.01);
  EXPECT_LT(aniso, 0.01 * iso);
  // A footprint along the step, four texels off it, sees nothing of it; a round one of its length does.
  float out, round;
  texture.anisotropic(0, 122, 128, Vec2(0, 32), Vec2(1, 0), 16, &out);
  texture.trilinear(0, 122, 128, 5.0f, &round);
  EXPECT_EQ(out, 0.0f);
  EXPECT_GT(round, 0.2f);
  // One tap is the isotropic lookup; footprints below a texel are bilinear.
  float one, bilinear;
  texture.anisotropic(0, 127.3f, 50, Vec2(0.5f, 0), Vec2(0, 0.2f), 16, &one);
  texture.bilinear(0, 127.3f, 50, 0, &bilinear);
  EXPECT_EQ(one, bilinear);
}

TEST(ShadowMipmap, NodeReadsTheFootprintOfThePixel) {
  // A pixel of width w seen face on is w * side texels wide: level log2 of it. Checked with the texture's own lookup.
  const int side = 64;
  const ShadowBasisPtr basis = makeExponentialBasis(5, false);
  const TermPtr depth = depthMap(side, [](int x, int y) { return random01(111, uint64_t(y * 99 + x)); });
  const TermPtr chain = chainOf(encodeBasis(depth, basis, 0), basis, side);
  const ShadowTexture texture(*chain, side);
  std::vector<Vec3> points;
  for (int i = 0; i < 100; ++i) points.push_back({random01(112, uint64_t(i)), random01(113, uint64_t(i)), 0.9f});
  for (float texels : {0.5f, 1.0f, 3.0f, 10.0f, 500.0f}) {
    ShadowLookup l = unitLookup(side);
    l.map.lookup = Settings::TRILINEAR;
    const auto V = values(lookupBasis(receivers(points, Vec3(0, 0, -1), texels / side), chain, basis, l), "V");
    for (size_t i = 0; i < points.size(); ++i) {
      float e, s;
      texture.trilinear(0, formulas::shadowTexel(points[i].x, side), formulas::shadowTexel(points[i].y, side), std::log2(std::max(texels, 1.0f)), &e);
      basis->reconstruct(&e, 1, &points[i].z, &s, 1);
      ASSERT_NEAR(V[i], std::min(s, 1.0f), 1e-5) << texels;
    }
  }
}

TEST(DepthBounds, RangesHoldTheKernelAndLittleMore) {
  for (int side : {1, 7, 64, 93}) {
    const auto z = [](int x, int y) { return random01(114, uint64_t(y * 999 + x)); };
    const TermPtr term = depthBounds(depthMap(side, z));
    const DepthBounds bounds(*term, side);
    for (int i = 0; i < 2000; ++i) {
      const auto pick = [&](uint64_t s) { return std::min(int(float(side) * random01(115 + s, uint64_t(i))), side - 1); };
      const int x0 = pick(0), x1 = std::min(x0 + pick(1) / 4, side - 1), y0 = pick(2), y1 = std::min(y0 + pick(3) / 4, side - 1);
      float lo, hi, low = 2, high = -1;
      bounds.range(0, x0, y0, x1, y1, lo, hi);
      for (int y = y0; y <= y1; ++y)
        for (int x = x0; x <= x1; ++x) low = std::min(low, z(x, y)), high = std::max(high, z(x, y));
      ASSERT_LE(lo, low);
      ASSERT_GE(hi, high);
      if (x1 - x0 <= 1 && y1 - y0 <= 1) { ASSERT_TRUE(lo == low && hi == high) << "two texels a side are exact"; }
    }
  }
}

}  // namespace

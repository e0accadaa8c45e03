// SPDX-License-Identifier: Apache-2.0
// The exponential map at its limits (Annen 2008, 7.2; digest 6): logarithmic filtering and percentage-closer, overshoot, slanted planes,
// exponents around float's end.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "filters/shadow_map/shadow_texture.h"
#include "unit/filters/shadow_map_cases.h"

namespace {

using namespace gobo;
using namespace gobo::shadowtest;
using Settings = v1::ShadowMapSettings;

std::vector<Vec3> scattered(int count, uint64_t seed, float z0, float z1) {
  std::vector<Vec3> points;
  for (int i = 0; i < count; ++i)
    points.push_back({random01(seed, uint64_t(i)), random01(seed + 1, uint64_t(i)), z0 + (z1 - z0) * random01(seed + 2, uint64_t(i))});
  return points;
}

TEST(ExponentialShadowLimits, LargeExponentsComparePercentageCloserWhereNothingLiesBehind) {
  // z <= d all over the kernel, z = d or 0.01 in front: s_ESM - s_PCF <= e^{-c 0.01}, 2e-9 at c = 2000 (digest 6.7, 1 and 2).
  const int size = 48;
  const TermPtr depth =
      depthMap(size, [](int x, int y) { return random01(51, uint64_t(y * 99 + x)) < 0.5f ? 0.75f : 0.74f * random01(52, uint64_t(y * 99 + x)); });
  const auto points = scattered(2000, 53, 0.75f, 0.75f);
  for (int blur : {0, 2, 5}) {
    const auto comparison = compare(depth, unitComparison(size, v1::PercentageCloserShadow::GAUSSIAN, blur), receivers(points));
    const auto V = visibility(depth, makeExponentialBasis(2000, true), blur, points);
    for (size_t i = 0; i < V.size(); ++i) ASSERT_NEAR(V[i], comparison[i], 3e-4) << blur;  // depth of 2^-24 and a rounded logarithm, times 2000
    const auto soft = visibility(depth, makeExponentialBasis(80, false), blur, points);
    for (size_t i = 0; i < V.size(); ++i) {
      ASSERT_GE(soft[i], comparison[i] - 1e-5);
      ASSERT_LE(soft[i], comparison[i] + std::exp(-0.8) + 1e-5);  // the nearest blocker is 0.01 away
    }
  }
}

TEST(ExponentialShadowLimits, LogarithmicFilteringIsLinearFiltering) {
  // Through every filter: pre-filter, chain, bilinear, trilinear, anisotropic. Both forms hold depths of 2^-24, times c = 80: 5e-6 each.
  const int size = 37;
  const TermPtr depth = depthMap(size, [](int x, int y) { return random01(54, uint64_t(y * 99 + x)); });
  const auto points = scattered(1500, 55, 0.0f, 1.0f);
  for (float c : {5.0f, 40.0f, 80.0f})
    for (int blur : {0, 3})
      for (const auto lookup : {Settings::BILINEAR, Settings::TRILINEAR, Settings::ANISOTROPIC}) {
        std::vector<float> V[2];
        for (int logarithmic = 0; logarithmic < 2; ++logarithmic) {
          const ShadowBasisPtr basis = makeExponentialBasis(c, logarithmic);
          TermPtr map = encodeBasis(depth, basis, blur);
          if (lookup != Settings::BILINEAR) map = runNode(makeShadowMipmapNode(basis, size, 1, false), {map});
          ShadowLookup l = unitLookup(size, blur);
          l.map.lookup = lookup;
          const TermPtr g = receivers(points, glm::normalize(Vec3(2, 0.5f, -1)), 0.09f);
          V[logarithmic] = values(lookupBasis(g, map, basis, l), "V");
        }
        for (size_t i = 0; i < points.size(); ++i) ASSERT_NEAR(V[0][i], V[1][i], 5e-5) << c << " " << blur << " lookup " << lookup;
      }
}

TEST(ExponentialShadowLimits, OneTexelBehindSaturatesAtItsMargin) {
  // One of n equally weighted texels at g behind the receiver, the others far in front: s = e^{c g} / n, lit from g = ln(n) / c on (6.3):
  // 0.0347 for 16 texels, 0.0693 for 256.
  for (const auto& [side, golden] : {std::pair{4, 0.0347}, {16, 0.0693}})
    for (bool logarithmic : {false, true}) {
      const float c = 80, d = 0.8f;
      const ShadowBasisPtr basis = makeExponentialBasis(c, logarithmic);
      const double margin = std::log(double(side) * side) / double(c);
      EXPECT_NEAR(margin, golden, 5e-5);
      for (double g : {margin - 0.01, margin - 0.001, margin + 0.001}) {
        const TermPtr map = runNode(makeShadowMipmapNode(basis, side, 1, false),
                                    {encodeBasis(depthMap(side, [&](int x, int y) { return x == 1 && y == 2 ? float(double(d) + g) : 0.1f; }), basis, 0)});
        float e, s;
        ShadowTexture(*map, side, basis->logarithmic()).trilinear(0, 0, 0, float(mipLevels(side) - 1), &e);
        basis->reconstruct(&e, 1, &d, &s, 1);
        EXPECT_NEAR(s, std::exp(double(c) * (g - margin)), 2e-4) << side << " " << g;
        EXPECT_EQ(s >= 1.0f, g > margin);
      }
    }
}

TEST(ExponentialShadowLimits, SlantedPlanesOvershootByTheirClosedForms) {
  // Box of half side r over slope m: sinh(x) / x, x = c m r: 1.042, 1.175, 1.81 at x = 1/2, 1, 2 (6.4). The texels' sum is sinh(x) / (n sinh(x / n)).
  const int n = 16;
  const float c = 80;
  const ShadowBasisPtr basis = makeExponentialBasis(c, false);
  for (const auto& [x, golden] : {std::pair{0.5, 1.042}, {1.0, 1.175}, {2.0, 1.813}}) {
    const double m = x / (double(c) * n / 2);
    const TermPtr map =
        runNode(makeShadowMipmapNode(basis, n, 1, false), {encodeBasis(depthMap(n, [&](int i, int) { return float(0.5 + m * (i - 7.5)); }), basis, 0)});
    float e, s;
    const float d = 0.5f;
    ShadowTexture(*map, n).trilinear(0, 0, 0, float(mipLevels(n) - 1), &e);
    basis->reconstruct(&e, 1, &d, &s, 1);
    EXPECT_NEAR(s, std::sinh(x) / (n * std::sinh(x / n)), 3e-5) << x;
    EXPECT_NEAR(s, golden, 0.003 * golden) << x;
  }
  // Gaussian: e^{x^2 / 2}, x = c m sigma, 1.133, 1.649, 7.39 for an endless kernel. Ours ends at 2 sigma, which cuts its variance to 0.77 to 0.79
  // of sigma^2 and more of its higher moments: the weights' own sum of cosh is exact, e^{x^2/2} its upper bound.
  const int blur = 8, size = 64;
  const auto w = gaussian(blur);
  for (const auto& [x, endless] : {std::pair{0.5, 1.133}, {1.0, 1.649}, {2.0, 7.39}}) {
    const double sigma = (2 * blur + 1) / 4.0, m = x / (double(c) * sigma);
    const auto E = values(encodeBasis(depthMap(size, [&](int i, int) { return float(0.5 + m * (i - 32)); }), basis, blur), "B");
    const float d = 0.5f;
    float s;
    basis->reconstruct(&E[32 * size + 32], 1, &d, &s, 1);
    double exact = 0;
    for (int k = -blur; k <= blur; ++k) exact += w[size_t(k + blur)] * std::cosh(double(c) * m * k);
    EXPECT_NEAR(s, exact, 3e-5 * exact) << x;
    EXPECT_LT(s, endless) << x;
    EXPECT_GT(s, 1 + 0.6 * x * x / 2) << x;
  }
}

TEST(ExponentialShadowLimits, ExponentsAroundFloatsEndStayFiniteThroughEveryFilter) {
  // e^{88.7} is float's end; unnormalised sums of e^{c z} would leave it after 6100 texels at c = 80, 112 at 84, 2 at 88 (6.1). Depths at
  // the far end make every texel the worst one.
  const int size = 128;
  const TermPtr depth = depthMap(size, [](int x, int y) { return x < 64 ? 1.0f : y < 32 ? 0.0f : random01(56, uint64_t(y * 999 + x)); });
  auto points = scattered(3000, 57, 0.0f, 1.0f);
  for (size_t i = 0; i < points.size(); i += 3) points[i].z = i % 2 ? 0.0f : 1.0f;
  for (float c : {80.0f, 84.0f, 88.0f, 90.0f, 500.0f, 2000.0f})
    for (int blur : {0, 4, 64}) {
      const ShadowBasisPtr basis = makeExponentialBasis(c, c > 80.0f);
      const TermPtr map = encodeBasis(depth, basis, blur);
      for (float b : map->floats("B")) ASSERT_TRUE(std::isfinite(b)) << c;
      const TermPtr chain = runNode(makeShadowMipmapNode(basis, size, 1, false), {map});
      for (float b : chain->floats("B")) ASSERT_TRUE(std::isfinite(b)) << c;
      for (const auto lookup : {Settings::BILINEAR, Settings::TRILINEAR, Settings::ANISOTROPIC})
        for (float footprint : {0.001f, 0.1f, 2.0f}) {
          ShadowLookup l = unitLookup(size, blur);
          l.map.lookup = lookup;
          const auto V =
              values(lookupBasis(receivers(points, glm::normalize(Vec3(3, 1, -1)), footprint), lookup == Settings::BILINEAR ? map : chain, basis, l), "V");
          for (size_t i = 0; i < V.size(); ++i) {
            ASSERT_TRUE(V[i] >= 0.0f && V[i] <= 1.0f) << c << " " << V[i];
            if (points[i].z == 0.0f) { ASSERT_GT(V[i], 1.0f - 1e-3f) << "nothing can lie in front of the near plane; c = " << c << " lookup " << lookup; }
          }
        }
    }
}

TEST(ExponentialShadowLimits, LargeExponentsScaleWithTheDepthRangeToo) {
  // Twice the range with half the exponent is the same picture, also where only logarithmic filtering goes.
  const auto run = [](float c, float scale) {
    const TermPtr depth = depthMap(16, [&](int x, int y) { return scale * (0.1f + 0.3f * random01(58, uint64_t(y * 16 + x))); });
    std::vector<Vec3> points;
    for (int i = 0; i < 300; ++i) points.push_back({random01(59, uint64_t(i)), random01(60, uint64_t(i)), scale * 0.4f});
    return visibility(depth, makeExponentialBasis(c, true), 2, points);
  };
  const auto a = run(400, 1), b = run(200, 2);
  for (size_t i = 0; i < a.size(); ++i) EXPECT_NEAR(a[i], b[i], 1e-4);  // depths of 2^-25, times 400
}

}  // namespace

// SPDX-License-Identifier: Apache-2.0
// The axis-aligned formulas against values computed by hand in double precision from the printed equations (digest of the report).
#include "formulas/axis_aligned.glsl.h"
#include "formulas/axis_aligned_indirect.glsl.h"

#include <gtest/gtest.h>

#include <cmath>

namespace gobo::formulas {
namespace {

struct Golden {
  double d1, d2min, d2max, sigma, d, beta, printed, capped, printedMu2;
};
const Golden kGolden[] = {
    {10, 5, 5, 1, .01, 1.0 / 3, 4.1616, 4.1616, 9.7344},
    {10, 2, 8, 1, .01, 1.0 / 12, 815.674, 815.674, 3373.29},
    {10, 5, 9, .5, .02, 1.0 / 54, 635.04, 635.04, 3789.6},
    {10, 5, 9.9, 1, .01, 0.0033670034, 156816, 40787.8, 1.397e6},
    {10, 9.9, 9.9, 1, .01, 0.0033670034, 62.73, 62.73, 317.6},
    {10, 9.999, 9.999, 1, .01, 0.0033336667, 163183, 16.32, 1.45e6},
    {10, 1, 1, 1, .01, 3.0, 0.1636, 0.1636, 0.376},
};

// The same equations in double precision, by distances: independent of how the formulas are arranged in float.
double printedDouble(const Golden& g, double mu) {
  const double s1 = g.d1 / g.d2min - 1, s2 = g.d1 / g.d2max - 1, areas = std::sqrt(g.d * g.d / (4 * g.sigma * g.sigma));
  return 4 * std::pow(1 + mu * s1 / s2, 2) * std::pow(mu * 2 / s2 * areas + g.d2max / g.d1, 2);
}
double betaDouble(const Golden& g) { return std::max(g.sigma * (g.d1 / g.d2max - 1), g.d * g.d1 / g.d2max) / 3; }

TEST(AxisAlignedFormulas, GoldenTable) {
  for (const Golden& g : kGolden) {
    SCOPED_TRACE(testing::Message() << g.d1 << " " << g.d2min << " " << g.d2max);
    const float s1 = float(g.d1 / g.d2min - 1), s2 = float(g.d1 / g.d2max - 1), sigma = float(g.sigma), d = float(g.d);
    const float beta = aaBeta(aaBandLimit(s2, sigma, d, 1.0f), 3.0f);
    // The table's own digits (4 to 6) bound how close it can be met; the double-precision forms are met to 1e-5.
    EXPECT_NEAR(beta / g.beta, 1, 1e-5);
    EXPECT_NEAR(beta / betaDouble(g), 1, 1e-5);
    EXPECT_NEAR(aaSamplesPrinted(s2, s1, sigma, d, 1.0f) / printedDouble(g, 1), 1, 1e-5);
    EXPECT_NEAR(aaSamplesPrinted(s2, s1, sigma, d, 2.0f) / printedDouble(g, 2), 1, 1e-5);
    EXPECT_NEAR(aaSamplesPrinted(s2, s1, sigma, d, 1.0f) / g.printed, 1, 3e-4);
    EXPECT_NEAR(aaSamplesCapped(s2, s1, sigma, d, 1.0f) / g.capped, 1, 3e-4);
    EXPECT_NEAR(aaSamplesPrinted(s2, s1, sigma, d, 2.0f) / g.printedMu2, 1, 3e-3);
  }
  // Rows whose digits are exact.
  EXPECT_NEAR(aaSamplesCapped(1, 1, 1, .01f, 1) / 4.1616, 1, 1e-5);
  EXPECT_NEAR(aaSamplesPrinted(1, 1, 1, .01f, 2) / 9.7344, 1, 1e-5);
  EXPECT_NEAR(aaSamplesPrinted(1.0f / 9, 1, .5f, .02f, 1) / 635.04, 1, 1e-5);
  EXPECT_NEAR(aaSamplesCapped(.25f, 4, 1, .01f, 1) / 815.6736, 1, 1e-5);
}

// Equations 4.4 and 4.6, by the source's numbers in double precision.
TEST(AxisAlignedFormulas, GoldenTableOfIndirectLight) {
  struct Row {
    double omega, zNear, zFar, samples;
  };
  for (const Row& r :
       {Row{2.8, 1, 1, 1.197}, {2.8, 1, 3, 4.540}, {2.8, .5, 5, 38.50}, {2.8, .1, 3, 749.2}, {4.44, 1, 3, 12.48}, {12, 1, 3, 131.3}, {2.8, .01, 3, 1.83e6}}) {
    const double d = 0.01, exact = 0.4 * std::pow(0.9 * r.omega * d / r.zNear + 0.3, 2) * r.omega * r.omega * std::pow(1 + 0.9 * r.zFar / r.zNear, 2);
    const float n = aaIndirectSamples(float(r.omega), float(d), float(r.zNear), float(r.zFar));
    EXPECT_NEAR(n / exact, 1, 1e-5);
    EXPECT_NEAR(n / r.samples, 1, 2e-3);
  }
  EXPECT_NEAR(aaOmegaSpecular(std::sqrt(2.0f / 12)), 4.44, 1e-5);   // m = 10
  EXPECT_NEAR(aaOmegaSpecular(std::sqrt(2.0f / 102)), 12.0, 1e-4);  // m = 100
  EXPECT_NEAR(aaOmegaSpecular(1.0f), 3.6, 1e-6);
  EXPECT_TRUE(std::isfinite(aaOmegaSpecular(0.0f)));
  // Per distance, and not below a share of a pixel.
  EXPECT_NEAR(aaIndirectWidthPrinted(1, 2.8f, .01f), 2 / 2.8, 1e-6);
  EXPECT_NEAR(aaIndirectWidthPrinted(1e-4f, 2.8f, .03f), 0.2, 1e-6);
  EXPECT_NEAR(aaIndirectWidthReleased(1, 2.8f, .01f, 0.9f), 0.198412698, 1e-6);
  EXPECT_NEAR(aaIndirectWidthReleased(1e-4f, 2.8f, .03f, 0.9f), 0.015, 1e-7);
}

TEST(AxisAlignedFormulas, SlopeIdentity) {
  // s = t/(T-t) = d1/d2 - 1 also when distances are taken along the light's normal: a slanted ray scales both alike.
  for (double cosine : {1.0, 0.7, 0.2})
    for (double d2 : {0.5, 2.0, 9.0}) {
      const double d1 = 10, T = d1 / cosine, t = (d1 - d2) / cosine;
      EXPECT_NEAR(aaSlope(float(t), float(T)) / (d1 / d2 - 1), 1, 1e-5);
    }
}

TEST(AxisAlignedFormulas, SlopeIsFiniteAtContactAndAtTheLight) {
  EXPECT_EQ(aaSlope(0, 10), AA_SLOPE_MIN);
  EXPECT_EQ(aaSlope(10, 10), AA_SLOPE_MAX);
  EXPECT_EQ(aaSlope(10.001f, 10), AA_SLOPE_MAX);  // rounding may put the hit a little behind the light
  EXPECT_EQ(aaSlope(1e-7f, 10), AA_SLOPE_MIN);
  for (float s : {AA_SLOPE_MIN, AA_SLOPE_MAX}) {
    EXPECT_TRUE(std::isfinite(aaBeta(aaBandLimit(s, 1, .01f, 1), 3)));
    EXPECT_TRUE(std::isfinite(aaSamplesCapped(s, s, 1, .01f, 1)));
  }
}

TEST(AxisAlignedFormulas, MonotoneAndCapped) {
  float lastBeta = 0;
  for (float s = 1e-4f; s < 1e3f; s *= 1.3f) {
    const float beta = aaBeta(aaBandLimit(s, .7f, .02f, 1), 3);
    EXPECT_GE(beta, lastBeta);
    lastBeta = beta;
    float lastN = 0;
    for (float ratio = 1; ratio < 100; ratio *= 1.5f) {
      const float n = aaSamplesCapped(s, s * ratio, .7f, .02f, 1);
      EXPECT_GE(n, lastN * 0.99999f);
      EXPECT_LE(n, aaSamplesPrinted(s, s * ratio, .7f, .02f, 1) * 1.00001f);
      lastN = n;
    }
    float lastMu = 0;
    for (float mu = .25f; mu < 64; mu *= 1.5f) {  // the budget solver bisects on this
      const float n = aaSamplesCapped(s, s * 3, .7f, .02f, mu);
      EXPECT_GE(n, lastMu * 0.99999f);
      lastMu = n;
    }
  }
}

TEST(AxisAlignedFormulas, ScaleFree) {
  for (float scale : {1e-3f, 1e3f}) {
    EXPECT_NEAR(aaSamplesCapped(.2f, .9f, .5f * scale, .01f * scale, 1) / aaSamplesCapped(.2f, .9f, .5f, .01f, 1), 1, 1e-5);
    EXPECT_NEAR(aaBandLimit(.2f, .5f * scale, .01f * scale, 1) * scale / aaBandLimit(.2f, .5f, .01f, 1), 1, 1e-5);
  }
}

TEST(AxisAlignedFormulas, DistantLightsAreTheLimitOfLightsThatGoAwayAndGrow) {
  // z and sigma_theta kept, d1 to infinity: slope z / d1, sigma = sigma_theta d1.
  for (const float z : {0.02f, 0.7f, 30.0f})
    for (const float ratio : {1.0f, 4.0f})
      for (const float sigma : {0.002f, 0.3f})
        for (const float d : {0.001f, 0.05f}) {
          const float d1 = 1e5f * z * ratio;
          for (const float mu : {0.5f, 1.0f, 3.0f}) {
            EXPECT_NEAR(aaDistantBandLimit(z, sigma, d, mu) / aaBandLimit(z / d1, sigma * d1, d, mu), 1, 3e-5);
            EXPECT_NEAR(aaDistantSamples(z, z * ratio, sigma, d, mu) / aaSamplesCapped(z / d1, z * ratio / d1, sigma * d1, d, mu), 1, 1e-4);
          }
          EXPECT_NEAR(aaBeta(aaDistantBandLimit(z, sigma, d, 1), 3) / (std::max(sigma * z, d) / 3), 1, 1e-5);
        }
  for (const float z : {aaDistance(0.0f), aaDistance(-1.0f), aaDistance(1e30f)}) {
    EXPECT_GT(z, 0.0f);
    for (const float sigma : {4e-7f, 0.5f}) {
      EXPECT_TRUE(std::isfinite(aaBeta(aaDistantBandLimit(z, sigma, .01f, 64), 3)));
      EXPECT_FALSE(std::isnan(aaDistantSamples(z, 1e18f, sigma, .01f, 64)));
      EXPECT_TRUE(std::isfinite(sigma * z) && sigma * z > 1.2e-38f);
    }
  }
}

TEST(AxisAlignedFormulas, Weight) {
  EXPECT_EQ(aaWeight(0, 7), 1.0f);
  for (double x = 0; x < 18; x += 0.0137) EXPECT_NEAR(aaWeight(float(x), 1) / std::exp(-double(float(x))), 1, 1e-6) << x;
  EXPECT_GT(aaWeight(1e30f, 1e6f), 0.0f);  // limited, not a wrapped exponent
  EXPECT_LT(aaWeight(1e30f, 1e6f), 1e-30f);
}

}  // namespace
}  // namespace gobo::formulas

// SPDX-License-Identifier: Apache-2.0
// The shared formulas against double-precision libm, and their behaviour at the ends of the float range.
#include <gtest/gtest.h>

#include <cfloat>
#include <cmath>
#include <limits>

#include "formulas/exponential_shadow_map.glsl.h"
#include "formulas/tone_map.glsl.h"

namespace {

using namespace gobo::formulas;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

/// |value - exact| in units of the spacing of floats at `exact`.
double ulps(float value, double exact) {
  int exponent;
  std::frexp(exact, &exponent);
  return std::fabs(double(value) - exact) / std::ldexp(1.0, std::max(exponent - 24, -149));
}

struct Worst {
  double ulp = 0, absolute = 0, at = 0;
};
template <typename F, typename G>
Worst sweep(double lo, double hi, int n, F f, G exact) {
  Worst w;
  for (int i = 0; i <= n; ++i) {
    const float x = float(lo + (hi - lo) * i / n);
    const double e = exact(double(x));
    const float v = f(x);
    if (ulps(v, e) > w.ulp) {
      w.ulp = ulps(v, e);
      w.at = x;
    }
    w.absolute = std::max(w.absolute, std::fabs(v - e));
  }
  return w;
}

TEST(Formulas, ExpWithinStatedError) {
  const Worst w = sweep(-87.33, 88.37, 4000000, fastExp, [](double x) { return std::exp(x); });
  RecordProperty("exp_ulp", std::to_string(w.ulp));
  EXPECT_LE(w.ulp, 1.0) << "at " << w.at;
  EXPECT_EQ(fastExp(0.0f), 1.0f);
}

TEST(Formulas, Exp2WithinStatedErrorAndExactForWholeStops) {
  const Worst w = sweep(-126, 127, 4000000, fastExp2, [](double x) { return std::exp2(x); });
  RecordProperty("exp2_ulp", std::to_string(w.ulp));
  EXPECT_LE(w.ulp, 1.0) << "at " << w.at;
  for (int n = -126; n <= 127; ++n) EXPECT_EQ(fastExp2(float(n)), std::ldexp(1.0f, n));
}

TEST(Formulas, LogWithinStatedError) {
  Worst w = sweep(1e-3, 4, 2000000, fastLog, [](double x) { return std::log(x); });
  for (int e = -126; e < 128; ++e) {
    const Worst v = sweep(std::ldexp(1.0, e), std::ldexp(2.0, e) * (1 - 1e-7), 4000, fastLog, [](double x) { return std::log(x); });
    if (v.ulp > w.ulp) w = v;
  }
  RecordProperty("log_ulp", std::to_string(w.ulp));
  EXPECT_LE(w.ulp, 1.0) << "at " << w.at;
  EXPECT_EQ(fastLog(1.0f), 0.0f);
}

TEST(Formulas, SinAndCosWithinStatedError) {
  const auto s = [](double x) { return std::sin(x); };
  const auto c = [](double x) { return std::cos(x); };
  const double quarter = std::acos(-1.0) / 2;
  RecordProperty("sin_ulp", std::to_string(sweep(-quarter, quarter, 2000000, fastSin, s).ulp));
  const double worst = std::max(sweep(-8192, 8192, 4000000, fastSin, s).absolute, sweep(-8192, 8192, 4000000, fastCos, c).absolute);
  RecordProperty("sin_cos_absolute_e8", std::to_string(1e8 * worst));
  EXPECT_LE(sweep(-quarter, quarter, 2000000, fastSin, s).ulp, 1.2);
  EXPECT_LE(worst, 1e-7);
}

TEST(Formulas, EveryInputGivesAFiniteValue) {
  for (float x : {kNan, kInf, -kInf, FLT_MAX, -FLT_MAX, FLT_MIN, FLT_MIN / 4, 0.0f, -0.0f, 1e30f, -1e30f}) {
    for (auto f : {fastExp, fastExp2, fastLog, fastSin, fastCos, exposureScale, toneMapLinear, toneMapReinhard, toneMapFilmic})
      EXPECT_TRUE(std::isfinite(f(x))) << x;
    for (float c : {1.0f, 60.0f, 80.0f}) {
      EXPECT_TRUE(std::isfinite(esmEncode(x, c))) << x;
      EXPECT_TRUE(std::isfinite(esmReceiver(x - 1.0f, c))) << x;
      for (float z : {0.0f, 1.0f, kNan, kInf}) {
        const float v = esmVisibility(esmEncode(z, c), esmReceiver(x - 1.0f, c), true);
        EXPECT_TRUE(v >= 0.0f && v <= 1.0f) << x << " " << z;
      }
    }
    EXPECT_TRUE(std::isfinite(shadowInverse(x))) << x;
    EXPECT_TRUE(shadowTexel(x, 7.0f) >= 0.0f && shadowTexel(x, 7.0f) <= 6.0f) << x;
  }
  EXPECT_EQ(fastExp(-kInf), fastExp(-87.33f));  // saturates: never 0, never infinite
  EXPECT_EQ(fastExp(kInf), fastExp(88.37f));
}

TEST(Formulas, ExponentialShadowIsTheExponentialOfTheGap) {
  // z <= d: s = e^{-c (d - z)} to the rounding of depths near 1 times c; a receiver in front of the blocker is lit.
  for (float c : {1.0f, 20.0f, 60.0f, 80.0f})
    for (int i = 0; i <= 100; ++i)
      for (int j = i; j <= 100; ++j) {
        const float z = float(i) / 100, d = float(j) / 100;
        const double exact = std::exp(-double(c) * (double(d) - double(z)));
        EXPECT_NEAR(esmVisibility(esmEncode(z, c), esmReceiver(d, c), true), exact, 1e-5) << c << " " << z << " " << d;
        EXPECT_GE(esmVisibility(esmEncode(d, c), esmReceiver(z, c), true), 1.0f - 1e-5f);
      }
  EXPECT_EQ(esmEncode(kNan, 60.0f), 1.0f);  // a damaged texel counts as nothing hit
  EXPECT_EQ(esmVisibility(0.0f, 1.0f, false), 1.0f);
  EXPECT_TRUE(shadowCovered(0.5f, 0.5f, 1.0f));
  for (float bad : {-1e-6f, 1.0001f, kNan, kInf}) {
    EXPECT_FALSE(shadowCovered(bad, 0.5f, 1.0f));
    EXPECT_FALSE(shadowCovered(0.5f, bad, 1.0f));
  }
  for (float w : {0.0f, -1.0f, kNan, -kInf}) {
    EXPECT_EQ(shadowInverse(w), 0.0f);  // behind the light
    EXPECT_FALSE(shadowCovered(0.0f, 0.0f, shadowInverse(w)));
  }
}

TEST(Formulas, ToneCurvesAreMonotoneAndCloseToTheirDefinitions) {
  for (auto f : {toneMapLinear, toneMapReinhard, toneMapFilmic}) {
    EXPECT_EQ(f(0.0f), 0.0f);
    EXPECT_EQ(f(-1.0f), 0.0f);
    EXPECT_EQ(f(kNan), 0.0f);
    EXPECT_GE(f(kInf), 0.999f);
    float last = 0.0f;
    for (float x = 1e-4f; x < 1e6f; x *= 1.01f) {
      EXPECT_GE(f(x), last);
      EXPECT_LE(f(x), 1.0f);
      last = f(x);
    }
  }
  EXPECT_EQ(toneMapLinear(0.25f), 0.25f);
  EXPECT_FLOAT_EQ(toneMapReinhard(3.0f), 0.75f);
  EXPECT_NEAR(toneMapFilmic(0.18f), 0.18 * (2.51 * 0.18 + 0.03) / (0.18 * (2.43 * 0.18 + 0.59) + 0.14), 1e-6);
  EXPECT_LT(toneMapFilmic(7.0f), 1.0f);
  EXPECT_EQ(toneMapFilmic(7.5f), 1.0f);
  EXPECT_EQ(exposureScale(-3.0f), 0.125f);
}

// S. Hill's fit on greys is its rational curve alone (rows of both matrices sum to 1), for colours the matrices written out.
TEST(Formulas, AcesClosedFormPoints) {
  const auto curve = [](double x) { return (x * (x + 0.0245786) - 0.000090537) / (x * (0.983729 * x + 0.4329510) + 0.238081); };
  for (double x : {0.01, 0.18, 0.5, 1.0, 4.0, 10.0}) {
    const float v = float(x);
    EXPECT_NEAR(toneMapAcesRed(v, v, v), curve(x), 2e-6) << x;
    EXPECT_NEAR(toneMapAcesGreen(v, v, v), curve(x), 2e-6) << x;
    EXPECT_NEAR(toneMapAcesBlue(v, v, v), curve(x), 2e-5) << x;  // the published row sums to 0.99999
  }
  EXPECT_LT(toneMapAcesRed(25.0f, 25.0f, 25.0f), 1.0f);
  EXPECT_EQ(toneMapAcesRed(26.0f, 26.0f, 26.0f), 1.0f);  // 0.016271 x^2 = 0.4083724 x + 0.2381715 at 25.67
  const double r = 0.8, g = 0.2, b = 0.05;
  const double x = curve(0.59719 * r + 0.35458 * g + 0.04823 * b), y = curve(0.076 * r + 0.90834 * g + 0.01566 * b),
               z = curve(0.0284 * r + 0.13383 * g + 0.83777 * b);
  EXPECT_NEAR(toneMapAcesRed(0.8f, 0.2f, 0.05f), 1.60475 * x - 0.53108 * y - 0.07367 * z, 2e-6);
  EXPECT_NEAR(toneMapAcesGreen(0.8f, 0.2f, 0.05f), -0.10208 * x + 1.10813 * y - 0.00605 * z, 2e-6);
  EXPECT_GT(toneMapAcesBlue(1000.0f, 0.0f, 0.0f), 0.1f) << "bright red goes to white";
}

// Khronos PBR Neutral: 6.25 x^2 at the foot, x - 0.04 in the middle, 1 - 0.0576 / (x - 0.04 - 0.52) above 0.8, on greys.
TEST(Formulas, NeutralClosedFormPoints) {
  const auto grey = [](float x) { return toneMapNeutral(x, x, x, x); };
  EXPECT_NEAR(grey(0.04f), 6.25 * 0.04 * 0.04, 1e-7);
  EXPECT_NEAR(grey(0.08f), 0.04, 1e-6);  // where foot and middle meet
  EXPECT_NEAR(grey(0.5f), 0.46, 1e-6);
  EXPECT_NEAR(grey(0.8f), 0.76, 1e-6);                 // where the compression starts
  EXPECT_NEAR(grey(0.8f + 1e-4f), 0.76 + 1e-4, 1e-6);  // with slope 1
  EXPECT_NEAR(grey(2.0f), 1.0 - 0.0576 / (1.96 - 0.52), 1e-6);
  // A base colour keeps its differences (hue and saturation); a highlight of the same hue is desaturated.
  EXPECT_NEAR(toneMapNeutral(0.6f, 0.6f, 0.3f, 0.1f) - toneMapNeutral(0.3f, 0.6f, 0.3f, 0.1f), 0.3, 1e-6);
  const float peak = 8.0f - 0.04f, top = 1.0f - 0.0576f / (peak - 0.52f), mix = 1.0f - 1.0f / (0.15f * (peak - top) + 1.0f);
  EXPECT_NEAR(toneMapNeutral(8.0f, 8.0f, 1.0f, 0.1f), top, 1e-6);
  EXPECT_NEAR(toneMapNeutral(1.0f, 8.0f, 1.0f, 0.1f), (0.96f * top / peak) * (1 - mix) + top * mix, 1e-6);
}

TEST(Formulas, ColourCurvesAreMonotoneOnGreysAndFinite) {
  for (auto f : {+[](float x) { return toneMapAcesRed(x, x, x); }, +[](float x) { return toneMapAcesGreen(x, x, x); },
                 +[](float x) { return toneMapAcesBlue(x, x, x); }, +[](float x) { return toneMapNeutral(x, x, x, x); }}) {
    EXPECT_EQ(f(0.0f), 0.0f);
    EXPECT_EQ(f(-1.0f), 0.0f);
    EXPECT_EQ(f(kNan), 0.0f);
    EXPECT_GE(f(kInf), 0.99f);
    float last = 0.0f;
    for (float x = 1e-4f; x < 1e6f; x *= 1.01f) {
      EXPECT_GE(f(x), last - 1e-7f) << x;
      EXPECT_LE(f(x), 1.0f);
      last = f(x);
    }
  }
  for (float x : {kNan, kInf, -kInf, FLT_MAX, FLT_MIN, 1e30f})
    for (float y : {kNan, kInf, 0.0f, 1.0f, 1e30f})
      for (float v : {toneMapAcesRed(x, y, 1.0f), toneMapAcesBlue(y, 0.0f, x), toneMapNeutral(x, x, y, 1.0f), toneMapNeutral(y, x, y, 0.0f)})
        EXPECT_TRUE(v >= 0.0f && v <= 1.0f) << x << " " << y;
}

}  // namespace

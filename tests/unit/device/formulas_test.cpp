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

struct Worst { double ulp = 0, absolute = 0, at = 0; };
template <typename F, typename G> Worst sweep(double lo, double hi, int n, F f, G exact) {
  Worst w;
  for (int i = 0; i <= n; ++i) {
    const float x = float(lo + (hi - lo) * i / n);
    const double e = exact(double(x));
    const float v = f(x);
    if (ulps(v, e) > w.ulp) { w.ulp = ulps(v, e); w.at = x; }
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
      EXPECT_TRUE(std::isfinite(esmReceiver(x, c, 1.0f))) << x;
      for (float z : {0.0f, 1.0f, kNan, kInf}) {
        const float v = esmVisibility(esmEncode(z, c), esmReceiver(x, c, 1.0f), true);
        EXPECT_TRUE(v >= 0.0f && v <= 1.0f) << x << " " << z;
      }
    }
    EXPECT_TRUE(std::isfinite(esmInverse(x))) << x;
    EXPECT_TRUE(esmTexel(x, 7.0f) >= 0.0f && esmTexel(x, 7.0f) <= 6.0f) << x;
  }
  EXPECT_EQ(fastExp(-kInf), fastExp(-87.33f));   // saturates: never 0, never infinite
  EXPECT_EQ(fastExp(kInf), fastExp(88.37f));
}

TEST(Formulas, ExponentialShadowIsTheExponentialOfTheGap) {
  // z <= d: s = e^{-c (d - z)} to the rounding of depths near 1 times c; a receiver in front of the blocker is lit.
  for (float c : {1.0f, 20.0f, 60.0f, 80.0f})
    for (int i = 0; i <= 100; ++i)
      for (int j = i; j <= 100; ++j) {
        const float z = float(i) / 100, d = float(j) / 100;
        const double exact = std::exp(-double(c) * (double(d) - double(z)));
        EXPECT_NEAR(esmVisibility(esmEncode(z, c), esmReceiver(d, c, 0.0f), true), exact, 1e-5) << c << " " << z << " " << d;
        EXPECT_GE(esmVisibility(esmEncode(d, c), esmReceiver(z, c, 0.0f), true), 1.0f - 1e-5f);
      }
  EXPECT_EQ(esmEncode(kNan, 60.0f), 1.0f);       // a damaged texel counts as nothing hit
  EXPECT_EQ(esmVisibility(0.0f, 1.0f, false), 1.0f);
  EXPECT_TRUE(esmCovered(0.5f, 0.5f, 1.0f));
  for (float bad : {-1e-6f, 1.0001f, kNan, kInf}) {
    EXPECT_FALSE(esmCovered(bad, 0.5f, 1.0f));
    EXPECT_FALSE(esmCovered(0.5f, bad, 1.0f));
  }
  for (float w : {0.0f, -1.0f, kNan, -kInf}) {
    EXPECT_EQ(esmInverse(w), 0.0f);             // behind the light
    EXPECT_FALSE(esmCovered(0.0f, 0.0f, esmInverse(w)));
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

}  // namespace

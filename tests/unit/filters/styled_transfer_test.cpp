// SPDX-License-Identifier: Apache-2.0
// What a style makes of a distance: steps of light, layers, numbers that vary from place to place, patterns.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "filters/stylised/abstraction.h"
#include "filters/stylised/edge_mean.h"
#include "filters/stylised/pattern.h"
#include "filters/stylised/style_parameters.h"
#include "filters/stylised/transfer.h"
#include "formulas/stylised_shadow.glsl.h"
#include "unit/filters/synthetic.h"

namespace gobo {
namespace styled_transfer_test {

using namespace test;

std::shared_ptr<Term> distances(const Extent& e, float from, float step) {
  return floatTerm(e, "D", [=](int x, int, int) { return from + step * float(x); });
}
std::vector<float> plane(const TermPtr& t, const char* name) {
  const auto p = t->floats(name);
  return {p.begin(), p.end()};
}
std::vector<float> styled(const StyleTransferSettings& s, std::vector<TermPtr> in) { return plane(runFilter(makeStyleTransferNode(s), std::move(in)), "V"); }

StyleTransferSettings band(StyleTransition t, int steps = 4) {
  StyleTransferSettings s;
  s.softness = 1;
  s.transition = t;
  s.steps = steps;
  return s;
}

TEST(StyleTransition, QuinticHasNoJumpOfCurvature) {
  EXPECT_EQ(formulas::quinticStep01(-0.1f), 0.0f);
  EXPECT_EQ(formulas::quinticStep01(0.0f), 0.0f);
  EXPECT_EQ(formulas::quinticStep01(0.5f), 0.5f);
  EXPECT_EQ(formulas::quinticStep01(1.0f), 1.0f);
  EXPECT_EQ(formulas::quinticStep01(1e30f), 1.0f);
  const auto second = [](double t) {  // in double: 60 t - 180 t^2 + 120 t^3
    const double h = 1e-2;
    const auto f = [](double u) { return double(formulas::quinticStep01(float(u))); };
    return (f(t + h) - 2 * f(t) + f(t - h)) / (h * h);
  };
  EXPECT_NEAR(second(0.0), 0.0, 0.2) << "a smoothstep has 6 here, taken to both sides 3";
  EXPECT_NEAR(second(1.0), 0.0, 0.2);
  EXPECT_NEAR(second(0.25), 60 * 0.25 - 180 * 0.0625 + 120 * 0.015625, 0.05);
  float last = 0;
  for (int k = 0; k <= 1000; ++k) {
    const float v = formulas::quinticStep01(float(k) / 1000);
    EXPECT_GE(v, last);
    last = v;
  }
}

TEST(StyleTransition, StaircasesHaveTheirSteps) {
  const Extent e{1001, 1, 1};
  for (const int steps : {1, 2, 4, 7, 256}) {
    const auto S = styled(band(StyleTransition::Staircase, steps), {distances(e, -0.55f, 1.1f / 1000)});
    std::vector<float> seen;
    for (const float v : S)
      if (seen.empty() || v != seen.back()) seen.push_back(v);
    ASSERT_EQ(seen.size(), size_t(steps) + 2) << steps;
    for (size_t k = 0; k < seen.size(); ++k) EXPECT_NEAR(seen[k], double(k) / double(steps + 1), 1e-6);
    EXPECT_EQ(seen.front(), 0.0f);
    EXPECT_EQ(seen.back(), 1.0f);
  }
  EXPECT_NEAR(styled(band(StyleTransition::Staircase, 2), {distances({3, 1, 1}, -0.3f, 0.3f)})[1], 2.0 / 3.0, 1e-6) << "d = 0: the second of two bands begins";
}

TEST(StyleTransition, EachKindIsHardWithoutSoftness) {
  for (const StyleTransition t : {StyleTransition::Smoothstep, StyleTransition::Quintic, StyleTransition::Staircase}) {
    StyleTransferSettings s = band(t);
    s.softness = 0;
    s.brightness = 0.25f;
    const auto S = styled(s, {distances({3, 1, 1}, -1e-20f, 1e-20f)});
    EXPECT_EQ(S[0], 0.25f);
    EXPECT_EQ(S[1], 0.25f);
    EXPECT_EQ(S[2], 1.0f);
  }
}

TEST(StyleLayers, AreTheMeanByTheirWeights) {
  const Extent e{64, 3, 2};
  const auto D = distances(e, -1, 0.03f), blurred = distances(e, -0.8f, 0.025f);
  StyleTransferSettings s;
  s.softness = 0.2f, s.brightness = 0.1f, s.distances = 2;
  s.layers = {{0.1f, 0.5f, 0.3f, 2.0, 0}, {-0.2f, 0, 0, 0.5, 1}};
  const auto S = styled(s, {D, blurred});
  for (size_t k = 0; k < S.size(); ++k) {
    const double a = formulas::styledVisibility(D->floats("D")[k], 0, 0.2f, 0.1f), b = formulas::styledVisibility(D->floats("D")[k], 0.1f, 0.5f, 0.3f),
                 c = formulas::styledVisibility(blurred->floats("D")[k], -0.2f, 0, 0);
    EXPECT_NEAR(S[k], (a + 2 * b + 0.5 * c) / 3.5, 1e-6);
  }
  EXPECT_EQ(S.back(), 1.0f) << "full light stays full";
  StyleTransferSettings none = s;
  none.layers.clear(), none.distances = 1;
  StyleTransferSettings same = none;
  same.layers = {{0, 0.2f, 0.1f, 3.0, 0}};
  const auto one = styled(none, {D}), twice = styled(same, {D});
  for (size_t k = 0; k < one.size(); ++k) EXPECT_NEAR(one[k], twice[k], 1e-7) << "a layer like the style itself changes nothing";
}

std::pair<StyleField, StyleFormula> formulaOf(StyleField field, const std::string& text, double low, double high) {
  auto f = Formula::parse(text, kStyleNames, "request.expressions.x.formula");
  EXPECT_TRUE(f.ok()) << f.status().toString();
  return {field, StyleFormula{*f, low, high, "request.expressions.x.formula"}};
}

struct Floor {
  Extent e{40, 30, 2};
  std::shared_ptr<Term> g, d, D;
  Floor() {
    PlaneView v;
    v.width = e.width, v.height = e.height, v.layers = e.layers;
    v.du = Vec3(0.1f, 0, 0), v.dv = Vec3(0, 0.1f, 0);
    g = planeGBuffer(v);
    d = floatTerm(e, "d", [](int x, int y, int l) { return 0.1f * float(x) + float(y) + 100.0f * float(l); });
    D = floatTerm(e, "D", [](int x, int, int) { return float(x) - 20.5f; });
  }
};

TEST(StyleParameters, AreTheFormulasWhereTheyAre) {
  const Floor floor;
  auto instance = floor.g->writable<uint32_t>("instance");
  for (size_t k = 0; k < instance.size(); ++k) instance[k] = k % 7 == 0 ? ~0u : k % 3;
  auto all = std::vector{formulaOf(StyleField::Inflation, "distance + 10*x - y + nz + 0*depth", -1e9, 1e9), formulaOf(StyleField::Softness, "edge*time", 0, 10),
                         formulaOf(StyleField::Brightness, "0.25 * object(\"two\") + 0.5 * object(\"any\")", 0, 1)};
  all[2].second.objects = {{{2}, -1}, {{0, 1, 2}, -1}};
  const auto P = floor.g->floats("P"), N = floor.g->floats("N"), d = floor.d->floats("d"), D = floor.D->floats("D");
  std::vector<TermPtr> out;
  for (const int threads : {1, 3}) out.push_back(runFilter(makeStyleParametersNode(floor.e, all, 0.5), {floor.g, floor.d, floor.D}, threads));
  for (const TermPtr& t : out)
    for (size_t k = 0; k < P.size() / 3; ++k) {
      if (instance[k] == ~0u) {
        EXPECT_EQ(t->floats("inflation")[k], 0.0f);
        continue;
      }
      EXPECT_EQ(t->floats("inflation")[k], float(double(d[k]) + 10 * double(P[3 * k]) - double(P[3 * k + 1]) + double(N[3 * k + 2])));
      EXPECT_EQ(t->floats("softness")[k], float(std::clamp(double(D[k]) * 0.5, 0.0, 10.0))) << "limited to the field's range";
      EXPECT_EQ(t->floats("brightness")[k], instance[k] == 2 ? 0.75f : 0.5f);
    }
}

TEST(StyleParameters, WhatIsNoNumberIsRefusedWithItsPlace) {
  const Floor floor;
  const auto f = std::vector{formulaOf(StyleField::Softness, "sqrt(5.25 - edge)", 0, 10)};  // not of edge 5.5 and more: x = 26
  for (const int threads : {1, 4}) {
    const auto r = tryFilter(makeStyleParametersNode(floor.e, f, 0), {floor.g, floor.D}, threads);
    ASSERT_FALSE(r.ok());
    EXPECT_EQ(r.status().code(), Code::InvalidArgument);
    EXPECT_EQ(r.status().location(), "request.expressions.x.formula");
    EXPECT_NE(r.status().message().find("at pixel 26, 0, where edge = 5.5"), std::string::npos) << r.status().toString();
    // With a guard of 15 pixels around the picture, the picture's pixel.
    const auto guarded = tryFilter(makeStyleParametersNode(floor.e, f, 0, {-15, -15, 10, 0}), {floor.g, floor.D}, threads);
    ASSERT_FALSE(guarded.ok());
    EXPECT_NE(guarded.status().message().find("at pixel 11, -15, where edge = 5.5"), std::string::npos) << guarded.status().toString();
  }
}

TEST(StyleParameters, TransferAndAbstractionReadThem) {
  const Floor floor;
  StyleTransferSettings s;
  s.softness = 3;  // not asked
  s.inflation = 0.25f;
  s.varyingSoftness = s.varyingBrightness = true;
  const auto parameters = runFilter(
      makeStyleParametersNode(floor.e, {formulaOf(StyleField::Softness, "1 + x", 0, 1e9), formulaOf(StyleField::Brightness, "0.1 * y", 0, 1)}, 0), {floor.g});
  const auto S = styled(s, {floor.D, parameters});
  const auto P = floor.g->floats("P"), D = floor.D->floats("D");
  for (size_t k = 0; k < S.size(); ++k)
    EXPECT_EQ(S[k], formulas::styledVisibility(D[k], 0.25f, float(1 + double(P[3 * k])), float(std::clamp(0.1 * double(P[3 * k + 1]), 0.0, 1.0))));
  // A sigma that is the same everywhere is a sigma; two halves are each their own.
  const auto waves = floatTerm(floor.e, "D", [](int x, int y, int) { return std::sin(float(x) * 0.7f) + 0.1f * float(y) - 1.0f; });
  const auto blurred = [&](const std::string& sigma) {
    const auto p = runFilter(makeStyleParametersNode(floor.e, {formulaOf(StyleField::Abstraction, sigma, 0, 1e9)}, 0), {floor.g});
    return runFilter(makeStyleAbstractionNode({floor.e, 0, kPi / 4, true}), {waves, floor.g, p});
  };
  const auto plain = [&](float sigma) { return runFilter(makeStyleAbstractionNode({floor.e, sigma, kPi / 4}), {waves, floor.g}); };
  const auto same = blurred("0.2"), wide = plain(0.2f), narrow = plain(0.1f), halves = blurred("x < 2 ? 0.2 : x < 3 ? 0.1 : 0");
  const auto from = waves->floats("D");
  const float split = P[3 * 20];
  size_t different = 0;
  for (size_t k = 0; k < from.size(); ++k) {
    EXPECT_NEAR(same->floats("D")[k], wide->floats("D")[k], 1e-5);
    const float x = P[3 * k];
    if (std::abs(x - 2) < 0.01f || std::abs(x - 3) < 0.01f) continue;
    EXPECT_NEAR(halves->floats("D")[k], x < 2 ? wide->floats("D")[k] : x < 3 ? narrow->floats("D")[k] : from[k], 2e-5) << x;
    different += std::abs(wide->floats("D")[k] - narrow->floats("D")[k]) > 0.01f;
  }
  EXPECT_GT(different, 100u) << split;
  // Widths that are sampled at every third pixel and at every one, side by side.
  const auto coarse = blurred("0.9"), fine = plain(0.15f), both = blurred("x < 2 ? 0.9 : 0.15");
  for (size_t k = 0; k < from.size(); ++k)
    if (const float x = P[3 * k]; std::abs(x - 2) > 0.01f) { EXPECT_NEAR(both->floats("D")[k], (x < 2 ? coarse : fine)->floats("D")[k], 2e-5) << x; }
}

TEST(StylePattern, CoversWhatTheToneAsksFor) {
  for (const StylePattern p : {StylePattern::Hatching, StylePattern::CrossHatching, StylePattern::Stippling})
    for (const float spacing : {2.0f, 5.0f, 8.0f, 21.5f})
      for (const float angle : {0.0f, 0.6f, 2.2f})
        for (const float c : {0.0f, 0.02f, 0.1f, 0.3f, 0.5f, 0.6f, 0.85f, 0.99f, 1.0f}) {
          double sum = 0;
          const int n = 430;  // a whole number of periods is not needed: many of them
          for (int y = 0; y < n; ++y)
            for (int x = 0; x < n; ++x) {
              const float a = patternAt(p, spacing, angle, float(x) + 0.5f, float(y) + 0.5f, c);
              ASSERT_TRUE(a >= 0 && a <= 1);
              sum += a;
            }
          EXPECT_NEAR(sum / n / n, c, p == StylePattern::Stippling ? (spacing == 2.0f ? 0.06 : 0.02) : 0.006) << int(p) << " " << spacing << " " << angle;
        }
  EXPECT_EQ(patternAt(StylePattern::Hatching, 8, 0, 0.5f, 0.5f, 0.25f), 1.0f) << "horizontal lines: within 1 of row 0";
  EXPECT_EQ(patternAt(StylePattern::Hatching, 8, 0, 5.5f, 3.5f, 0.25f), 0.0f);
  EXPECT_EQ(patternAt(StylePattern::Hatching, 8, 0, 77.5f, 0.5f, 0.25f), 1.0f);
}

TEST(StylePattern, DrawsTonesInLightAndDark) {
  const Extent e{64, 64, 1};
  const auto V = floatTerm(e, "V", [](int x, int, int) { return x < 16 ? 0.2f : x < 32 ? 1.0f : 0.6f; });
  StylePatternSettings s;
  s.extent = e;
  s.brightness = 0.2f;
  for (const StylePattern p : {StylePattern::Hatching, StylePattern::CrossHatching, StylePattern::Stippling}) {
    s.pattern = p;
    const auto out = plane(runFilter(makeStylePatternNode(s), {V}), "V");
    double sum = 0;
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 64; ++x) {
        const float v = out[size_t(y * 64 + x)];
        if (x < 16) {
          ASSERT_EQ(v, 0.2f);
        } else if (x < 32) {
          ASSERT_EQ(v, 1.0f);
        } else sum += v;
        ASSERT_TRUE(v >= 0.2f && v <= 1.0f);
      }
    EXPECT_NEAR(sum / 32 / 64, 0.6, 0.02) << "the mean is the tone";
  }
  // A part of a film has the bits of the whole.
  s.pattern = StylePattern::Hatching;
  const auto whole = plane(runFilter(makeStylePatternNode(s), {V}), "V");
  StylePatternSettings part = s;
  part.extent = {20, 10, 1};
  part.place = {30, 7, 64, 64};
  const auto some = plane(runFilter(makeStylePatternNode(part), {floatTerm(part.extent, "V", [](int x, int, int) { return x + 30 < 32 ? 1.0f : 0.6f; })}), "V");
  for (int y = 0; y < 10; ++y)
    for (int x = 0; x < 20; ++x) EXPECT_EQ(some[size_t(y * 20 + x)], whole[size_t((y + 7) * 64 + x + 30)]);
}

TEST(EdgeMean, IsTheMeanTermByTerm) {
  // A floor whose shadow has an edge at x = 2 and one at x = 3.2, with distances that grow with y.
  const Extent e{64, 48, 1};
  PlaneView v;
  v.width = e.width, v.height = e.height;
  v.du = Vec3(0.1f, 0, 0), v.dv = Vec3(0, 0.1f, 0);
  const auto g = planeGBuffer(v);
  const auto V = floatTerm(e, "V", [](int x, int, int) { return x >= 20 && x < 32 ? 0.0f : 1.0f; });
  const auto d = floatTerm(e, "d", [](int x, int y, int) { return x == 20 ? 1.0f + 0.02f * float(y) : x == 31 ? 5.0f + 0.1f * float(y) : -1.0f; });
  std::vector<EdgePoint> edge;
  const auto P = g->floats("P");
  const auto at = [&](int x, int y) {
    const size_t k = size_t(y * e.width + x);
    return Vec3(P[3 * k], P[3 * k + 1], P[3 * k + 2]);
  };
  const Vec3 n = Vec3(g->floats("N")[0], g->floats("N")[1], g->floats("N")[2]);
  for (int y = 0; y < e.height; ++y) {
    edge.push_back({0.5f * (at(19, y) + at(20, y)), n, 0.1f, {1.0f + 0.02f * float(y)}});
    edge.push_back({0.5f * (at(31, y) + at(32, y)), n, 0.1f, {5.0f + 0.1f * float(y)}});
  }
  const auto whose = d->addPlane<uint32_t>("instance");
  for (size_t k = 0; k < whose.size(); ++k) whose[k] = k % 64 == 20 ? 7 : 9;
  const auto cast = runFilter(makeEdgeMeanNode({e, kPi / 4, {{3, 9}, {7}, {}}}), {d, V, g});
  const auto one = runFilter(makeEdgeMeanNode({e, kPi / 4}), {d, V, g}, 1), many = runFilter(makeEdgeMeanNode({e, kPi / 4}), {d, V, g}, 4);
  double most = 0;
  for (int y = 0; y < e.height; ++y)
    for (int x = 0; x < e.width; ++x) {
      const size_t k = size_t(y * e.width + x);
      EXPECT_EQ(one->floats("d")[k], many->floats("d")[k]);
      most = std::max(most, std::abs(double(one->floats("d")[k]) - edgeMeanAt(edge, at(x, y), n, 0.7f)));
      EXPECT_GE(one->floats("d")[k], 1.0f);
      EXPECT_LE(one->floats("d")[k], 9.71f);
    }
  EXPECT_LT(most, 0.01 * (9.7 - 1.0)) << "of the spread of the values";
  for (size_t k = 0; k < size_t(e.width * e.height); ++k) {
    const float nine = cast->floats("caster0")[k], seven = cast->floats("caster1")[k];
    EXPECT_NEAR(nine + seven, 1.0f, 1e-6) << "shares";
    EXPECT_EQ(cast->floats("caster2")[k], 0.0f);
    const size_t x = k % 64;
    if (x > 15 && x < 22) { EXPECT_GT(seven, 0.99f); }
    if (x > 29 && x < 36) { EXPECT_LT(seven, 0.01f); }
    EXPECT_EQ(cast->floats("d")[k], one->floats("d")[k]);
  }
  EXPECT_NEAR(one->floats("d")[20], 1.0f, 0.1f);
  EXPECT_NEAR(one->floats("d")[size_t(47 * e.width + 31)], 9.7f, 0.2f);
}

TEST(EdgeMean, LeavesOutEdgesThatAreTurnedAwayOneByOne) {
  // Every second row of the edge leans over by 80 degrees: the mean normal of a piece is within the guard, half of its points are not.
  const Extent e{64, 64, 1};
  PlaneView v;
  v.width = e.width, v.height = e.height;
  v.du = Vec3(0.1f, 0, 0), v.dv = Vec3(0, 0.001f, 0);
  const auto g = planeGBuffer(v);
  const auto N = g->writable<float>("N");
  for (int y = 1; y < e.height; y += 2)
    for (int x = 0; x < 20; ++x) N[size_t(3 * (y * e.width + x))] = std::sin(1.4f), N[size_t(3 * (y * e.width + x) + 2)] = std::cos(1.4f);
  const auto V = floatTerm(e, "V", [](int x, int, int) { return x >= 10 ? 1.0f : 0.0f; });
  const auto d = floatTerm(e, "d", [](int x, int y, int) { return x == 9 ? (y % 2 ? 100.0f : 1.0f) : -1.0f; });
  d->addPlane<uint32_t>("instance");
  const auto mean = runFilter(makeEdgeMeanNode({e, kPi / 4}), {d, V, g});
  for (int y = 0; y < e.height; y += 2)
    for (int x = 30; x < 60; ++x) EXPECT_NEAR(mean->floats("d")[size_t(y * e.width + x)], 1.0f, 1e-4) << x << " " << y;
}

TEST(EdgeMean, SeesNothingWhereThereIsNoEdge) {
  const Floor floor;
  const auto none = floatTerm(floor.e, "d", [](int, int, int) { return -1.0f; });
  none->addPlane<uint32_t>("instance");
  floor.d->addPlane<uint32_t>("instance");
  const auto V = floatTerm(floor.e, "V", [](int x, int, int) { return x < 20 ? 0.0f : 1.0f; });
  for (const float d : plane(runFilter(makeEdgeMeanNode({floor.e, kPi / 4}), {none, V, floor.g}), "d")) EXPECT_EQ(d, 0.0f);
  auto instance = floor.g->writable<uint32_t>("instance");
  std::fill(instance.begin(), instance.end(), ~0u);
  for (const float d : plane(runFilter(makeEdgeMeanNode({floor.e, kPi / 4}), {floor.d, V, floor.g}), "d")) EXPECT_EQ(d, 0.0f);
}

}  // namespace styled_transfer_test
}  // namespace gobo

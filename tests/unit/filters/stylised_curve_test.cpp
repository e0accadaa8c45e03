// SPDX-License-Identifier: Apache-2.0
// Transfers along a curve of one's own, and layers whose numbers vary from place to place.
#include <gtest/gtest.h>

#include <cmath>

#include "filters/stylised/pattern.h"
#include "filters/stylised/transfer.h"
#include "formulas/stylised_shadow.glsl.h"
#include "unit/filters/synthetic.h"

namespace gobo {
namespace stylised_curve_test {

using namespace test;

std::vector<float> styled(const StyleTransferSettings& s, std::vector<TermPtr> in) {
  const TermPtr out = runFilter(makeStyleTransferNode(s), std::move(in));
  const auto V = out->floats("V");
  return {V.begin(), V.end()};
}
StyleTransferSettings along(std::vector<float> curve, float softness = 1) {
  StyleTransferSettings s;
  s.softness = softness;
  s.transition = StyleTransition::Curve;
  s.curve = std::move(curve);
  return s;
}
TermPtr line(int n, float from, float step) {
  return floatTerm({n, 1, 1}, "D", [=](int x, int, int) { return from + step * float(x); });
}

TEST(StyleCurve, IsStraightBetweenItsValues) {
  const std::vector<float> curve{0.25f, 1, 0, 0.5f, 0.75f};
  StyleTransferSettings s = along(curve, 2);
  s.inflation = 0.5f, s.brightness = 0.2f;
  const auto D = line(2001, -1.0f, 0.0015f);
  const auto S = styled(s, {D});
  for (size_t k = 0; k < S.size(); ++k) {
    const double u = (double(D->floats("D")[k]) - 0.5) / 2 + 0.5, at = u * 4;
    if (std::abs(u) < 1e-6 || std::abs(u - 1) < 1e-6) continue;
    const size_t piece = std::min(size_t(std::max(at, 0.0)), size_t(3));
    const double t = u < 0 ? 0 : u > 1 ? 1 : double(curve[piece]) + (at - double(piece)) * (double(curve[piece + 1]) - double(curve[piece]));
    ASSERT_NEAR(double(S[k]), 0.2 + 0.8 * t, 2e-6) << u;
  }
  // Both ends of the band are the curve's; what lies beside it is full shadow and full light.
  const auto ends = styled(along(curve), {floatTerm({4, 1, 1}, "D", [](int x, int, int) { return std::vector{-0.5001f, -0.5f, 0.5f, 0.5001f}[size_t(x)]; })});
  EXPECT_EQ(ends, (std::vector<float>{0, 0.25f, 0.75f, 1}));
}

TEST(StyleCurve, OfTwoValuesIsALineAndWithoutSoftnessAnEdge) {
  const auto D = line(101, -0.6f, 0.012f);
  const auto S = styled(along({0, 1}), {D});
  for (size_t k = 0; k < S.size(); ++k) EXPECT_NEAR(S[k], std::clamp(D->floats("D")[k] + 0.5f, 0.0f, 1.0f), 1e-6f);
  StyleTransferSettings hard = along({0.7f, 0.3f, 0.1f}, 0);
  hard.brightness = 0.25f;
  EXPECT_EQ(styled(hard, {line(3, -1e-20f, 1e-20f)}), (std::vector<float>{0.25f, 0.25f, 1.0f}));
  EXPECT_EQ(styled(along({0.7f, 0.3f}), {floatTerm({2, 1, 1}, "D", [](int x, int, int) { return x ? 1e30f : -1e30f; })}), (std::vector<float>{0, 1}));
}

TEST(StyleCurve, ManyValuesAreHitEach) {
  std::vector<float> curve(256);
  for (size_t k = 0; k < curve.size(); ++k) curve[k] = float(k % 7) / 7;
  const auto S = styled(along(curve), {line(256, -0.5f, 1.0f / 255)});
  for (size_t k = 0; k < curve.size(); ++k) EXPECT_NEAR(S[k], curve[k], 1e-4) << k;
}

TEST(StyleCurve, IsOfLayersToo) {
  StyleTransferSettings s = along({0, 0.5f, 0.25f, 1});
  s.layers = {{0.3f, 0.5f, 0.1f, 2.0, 0}};
  const auto D = line(200, -1, 0.01f);
  StyleTransferSettings layer = along(s.curve, 0.5f), own = s;
  layer.inflation = 0.3f, layer.brightness = 0.1f, own.layers.clear();
  const auto both = styled(s, {D}), a = styled(own, {D}), b = styled(layer, {D});
  for (size_t k = 0; k < both.size(); ++k) EXPECT_NEAR(both[k], (a[k] + 2 * b[k]) / 3, 1e-6);
}

std::shared_ptr<Term> parameters(const Extent& e, std::vector<std::pair<const char*, float>> planes) {
  auto t = std::make_shared<Term>("style_parameters", Domain::ViewSample, e);
  for (const auto& [name, step] : planes) {
    const auto p = t->addPlane<float>(name);
    for (size_t k = 0; k < p.size(); ++k) p[k] = step * float(k % 50) / 50;
  }
  return t;
}

TEST(StyleLayers, VaryFromPlaceToPlace) {
  const Extent e{700, 3, 2};  // more than a run
  const auto D = floatTerm(e, "D", [](int x, int y, int) { return 0.003f * float(x - 350) + 0.1f * float(y); });
  StyleTransferSettings s;
  s.softness = 0.2f, s.varyingBrightness = true;
  s.layers = {{0.1f, 0.5f, 0.3f, 2.0, 0}, {-0.2f, 9, 9, 0.5, 0}, {7, 0.3f, 0.2f, 1.5, 0}};
  s.layers[1].varyingSoftness = s.layers[1].varyingBrightness = true;  // what it says itself is not asked
  s.layers[1].softness = 0.9f, s.layers[1].brightness = 0.9f;
  s.layers[2].varyingInflation = true;
  const auto own = parameters(e, {{"brightness", 0.4f}}), second = parameters(e, {{"brightness", 0.8f}, {"softness", 0.6f}}),
             third = parameters(e, {{"inflation", 0.5f}});
  const auto S = styled(s, {D, own, second, third});
  for (size_t k = 0; k < S.size(); ++k) {
    const float d = D->floats("D")[k], x = float(k % 50) / 50;
    const double sum = double(formulas::styledVisibility(d, 0, 0.2f, 0.4f * x)) + 2.0 * double(formulas::styledVisibility(d, 0.1f, 0.5f, 0.3f)) +
                       0.5 * double(formulas::styledVisibility(d, -0.2f, 0.6f * x, 0.8f * x)) +
                       1.5 * double(formulas::styledVisibility(d, 0.5f * x, 0.3f, 0.2f));
    ASSERT_NEAR(double(S[k]), sum / 5.0, 1e-6) << k;
  }
}

TEST(StyleLayers, ThatVaryAreAsDarkInAPatternAsTheyAre) {
  const Extent e{64, 64, 1};
  StylePatternSettings s;
  s.extent = e;
  s.brightness = 0.2f, s.ownShare = 0.25, s.rest = 0.1, s.layerShares = {0.5};
  const auto layer = parameters(e, {{"brightness", 0.6f}});
  const auto V = floatTerm(e, "V", [](int, int, int) { return 0.8f; });
  const TermPtr made = runFilter(makeStylePatternNode(s), {V, layer});
  const auto out = made->floats("V");
  size_t drawn = 0;
  for (size_t k = 0; k < out.size(); ++k) {
    const float dark = float(0.25 * 0.2 + 0.1 + 0.5 * 0.6 * double(float(k % 50)) / 50);
    ASSERT_GE(out[k], dark - 1e-5f);
    drawn += std::abs(out[k] - dark) < 1e-5f;
  }
  EXPECT_GT(drawn, 200u) << "lines are as dark as the full shadow there";
}

}  // namespace stylised_curve_test
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Levels of a soft visibility: each with its contour and its style, and the mean of them.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <set>

#include "filters/crop.h"
#include "filters/stylised/distance_field.h"
#include "filters/stylised/style_levels.h"
#include "filters/stylised/transfer.h"
#include "support/thorough.h"
#include "unit/filters/synthetic.h"

namespace gobo {
namespace stylised_levels_test {

using namespace test;

/// Runs a fold step by step.
TermPtr folded(const NodePtr& node, const std::vector<TermPtr>& inputs) {
  const auto* fold = dynamic_cast<const FoldNode*>(node.get());
  GOBO_CHECK(fold != nullptr);
  TaskArena arena(2);
  RunContext ctx;
  ctx.arena = &arena;
  std::vector<TermShape> shapes;
  for (const TermPtr& t : inputs) shapes.push_back(shapeOf(*t));
  const Result<TermShape> shape = node->infer(shapes);
  GOBO_CHECK(shape.ok());
  const auto first = inputs.begin() + fold->fixedInputs();
  auto state = fold->begin(ctx, {inputs.begin(), first});
  for (auto at = first; at != inputs.end(); ++at) GOBO_CHECK(fold->step(ctx, *state, int(at - first), {*at}).ok());
  ctx.result = makeTerm(*shape);
  const Result<TermPtr> r = fold->finish(ctx, std::move(state));
  GOBO_CHECK(r.ok());
  return *r;
}

/// The mean over `levels` of the styles of V on a plane.
TermPtr styled(const TermPtr& V, const TermPtr& g, int levels, const StyleTransferSettings& t, int power = 8) {
  std::vector<TermPtr> inputs;
  const bool coloured = V->channels("V") == 3;
  if (coloured) inputs.push_back(V);
  for (int k = 0; k < levels; ++k) {
    StyleDistanceSettings d;
    d.extent = V->extent();
    d.power = power;
    d.level = k;
    d.levels = levels;
    inputs.push_back(runFilter(makeStyleTransferNode(t), {runFilter(makeStyleDistanceNode(d), {V, g})}));
  }
  return folded(makeStyleLevelsNode(V->extent(), levels, coloured), inputs);
}
PlaneView view(const Extent& e, float pixel = 1.0f) {
  PlaneView v;
  v.width = e.width;
  v.height = e.height;
  v.layers = e.layers;
  v.du = Vec3(pixel, 0, 0);
  v.dv = Vec3(0, pixel, 0);
  return v;
}
float penumbra(float x, float from, float width) { return std::clamp((x - from) / width, 0.0f, 1.0f); }

TEST(StyleLevels, OfHardVisibilityAreOneToTheBit) {
  const Extent e = testing::thorough() ? Extent{41, 33, 2} : Extent{27, 21, 2};
  auto V = noiseTerm(e, "V", 6);
  for (float& v : V->writable<float>("V")) v = v < 0.4f ? 0.0f : 1.0f;
  const auto g = planeGBuffer(view(e));
  const StyleTransferSettings style{0.4f, 3.0f, 0.17f};
  StyleDistanceSettings d;
  d.extent = e;
  const auto one = runFilter(makeStyleTransferNode(style), {runFilter(makeStyleDistanceNode(d), {V, g})});
  for (const int levels : {1, 2, 3, 5, 7, 11, 64}) {
    const auto S = styled(V, g, levels, style);
    for (size_t i = 0; i < e.elements(); ++i)
      ASSERT_EQ(std::bit_cast<uint32_t>(S->floats("V")[i]), std::bit_cast<uint32_t>(one->floats("V")[i])) << levels << " levels at " << i;
  }
}

TEST(StyleLevels, OfANeutralStyleAreTheVisibilityInSteps) {  // and so it converges to V like 1 / (2 K)
  const Extent e{60, 12, 1};
  const auto V = floatTerm(e, "V", [](int x, int, int) { return penumbra(float(x), 17.3f, 24.0f); });
  for (const int levels : {2, 4, 16, 64}) {
    const auto S = styled(V, planeGBuffer(view(e)), levels, {});
    for (size_t i = 0; i < e.elements(); ++i) {
      const float v = V->floats("V")[i], s = S->floats("V")[i];
      ASSERT_LE(std::abs(s - v), 0.5f / float(levels) + 1e-6f) << levels << " at " << i;
      ASSERT_NEAR(s * float(levels), std::round(s * float(levels)), 1e-4f);
    }
  }
}

// A linear penumbra of width w: level t lies at x0 + t w, so S(x) = integral over t of f(x - x0 - t w), f the transfer; LOCAL's D is the distance of a straight
// edge.
TEST(StyleLevels, ConvergeToTheIntegralOverALinearPenumbra) {
  const Extent e{120, 160, 1};
  const float from = 52.3f, width = 13.0f;
  const auto V = floatTerm(e, "V", [&](int x, int, int) { return penumbra(float(x), from, width); });
  const auto g = planeGBuffer(view(e));
  const StyleTransferSettings style{3.5f, 6.0f, 0.2f};
  const auto error = [&](int levels) {
    const auto S = styled(V, g, levels, style);
    double most = 0;
    for (int x = 35; x < 90; ++x) {
      double expected = 0;
      constexpr int kSteps = 2000;
      for (int k = 0; k < kSteps; ++k) {
        const double t = (k + 0.5) / kSteps, d = double(x) - double(from) - t * double(width);
        const double u = std::clamp((d - 3.5) / 6.0 + 0.5, 0.0, 1.0);
        expected += (0.2 + 0.8 * u * u * (3 - 2 * u)) / kSteps;
      }
      most = std::max(most, std::abs(double(S->floats("V")[size_t(80 * 120 + x)]) - expected));
    }
    return most;
  };
  const double two = error(2), four = error(4), eight = error(8), many = error(32);
  EXPECT_GT(two, 2 * four);
  EXPECT_GT(four, 2 * eight);
  EXPECT_LT(eight, 0.01);
  EXPECT_LT(many, 0.002);
}

TEST(StyleLevels, ContoursAreInTheirOrder) {  // whatever the steepness of a step, and between the samples that they part
  const Extent e{6, 4, 1};
  for (const auto& [low, high] : {std::pair{0.0f, 1.0f}, {0.1f, 1.0f}, {0.0f, 0.7f}, {0.05f, 0.95f}, {0.3f, 0.6f}})
    for (const bool falling : {false, true}) {
      const auto V = floatTerm(e, "V", [&](int x, int, int) { return (x < 3) != falling ? low : high; });
      const auto g = planeGBuffer(view(e));
      float last = -1;
      for (int k = 0; k < 16; ++k) {
        const TaskArena arena(1);
        const auto contour = *extractContour(contourInput(*V, *g, 0, k, 16), 0.7f, arena, {});
        const float t = (float(k) + 0.5f) / 16;
        ASSERT_EQ(contour.size(), t > low && t <= high ? 3u : 0u) << low << " " << high << " " << t;
        for (const ContourSegment& s : contour) {
          ASSERT_NEAR(s.a.x, s.b.x, 1e-6f);
          const float at = falling ? 5 - s.a.x : s.a.x;
          ASSERT_GE(at, 2.0f);
          ASSERT_LE(at, 3.0f);
          ASSERT_GE(at, last - 1e-6f);
          if (high - low == 1.0f) { ASSERT_EQ(at, 2.5f); }
          if (high - low <= 0.5f) { ASSERT_NEAR(at, 2 + (t - low) / (high - low), 1e-5f); }
        }
        if (!contour.empty()) last = falling ? 5 - contour[0].a.x : contour[0].a.x;
      }
    }
}

TEST(StyleLevels, SignsAreThoseOfTheLevel) {
  const Extent e{23, 17, 1};
  const auto V = noiseTerm(e, "V", 12);
  for (int k = 0; k < 5; ++k) {
    StyleDistanceSettings d;
    d.extent = e;
    d.level = k;
    d.levels = 5;
    const auto D = runFilter(makeStyleDistanceNode(d), {V, planeGBuffer(view(e))});
    for (size_t i = 0; i < e.elements(); ++i) ASSERT_EQ(D->floats("D")[i] > 0, V->floats("V")[i] >= (float(k) + 0.5f) / 5);
  }
}

TEST(StyleLevels, ColourIsThatOfTheLight) {
  const Extent e{5, 1, 1};
  auto V = std::make_shared<Term>("visibility", Domain::ViewSample, e);
  const std::vector<float> tint{0.9f, 0.45f, 0.3f, 1, 1, 1, 0.1f, 0.2f, 0.3f, 0, 0, 0, 0.1f, 0.05f, 0.02f};
  std::copy(tint.begin(), tint.end(), V->addPlane<float>("V", 3).begin());
  const std::vector<float> s{0.75f, 1, 0.25f, 0.5f, 0.5f};
  std::vector<TermPtr> inputs{V};
  for (int k = 0; k < 4; ++k) inputs.push_back(floatTerm(e, "V", [&](int x, int, int) { return s[size_t(x)]; }));
  const auto S = folded(makeStyleLevelsNode(e, 4, true), inputs);
  const std::vector<float> expected{0.75f, 0.375f, 0.25f, 1,    1,    1,    0.25f / 3, 0.5f / 3,
                                    0.25f, 0.5f,   0.5f,  0.5f, 0.5f, 0.5f, 0.5f};  // the last is below every level
  for (size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(S->floats("V")[i], expected[i], 1e-6f) << i;
}

TEST(StyleLevels, OneLevelHasTheKeyOfBefore) {
  StyleDistanceSettings plain, one;
  one.level = 0, one.levels = 1;
  const auto key = [](const StyleDistanceSettings& s) {
    Hasher h;
    s.hash(h);
    return h.digest();
  };
  Hasher before;
  before.add(8).add(int(StyleNorm::Local)).add(plain.angle);
  EXPECT_EQ(key(plain), before.digest());
  EXPECT_EQ(key(one), before.digest());
  std::set<Hash128> keys{key(one)};
  for (int levels = 2; levels < 6; ++levels)
    for (int k = 0; k < levels; ++k) {
      one.level = k, one.levels = levels;
      EXPECT_TRUE(keys.insert(key(one)).second) << k << "/" << levels;
    }
}

TEST(Crop, KeepsEveryLayer) {
  const Extent e{9, 7, 3};
  const auto whole = noiseTerm(e, "V", 2);
  const auto part = runFilter(makeCropNode(e, 2, 3, 4, 2), {whole});
  ASSERT_EQ(part->extent(), (Extent{4, 2, 3}));
  EXPECT_EQ(part->content(), cropTerm(*whole, 2, 3, 4, 2)->content());
}

}  // namespace stylised_levels_test
}  // namespace gobo

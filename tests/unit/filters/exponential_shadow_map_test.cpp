// SPDX-License-Identifier: Apache-2.0
// Exponential shadow map filters against closed forms, brute force in double, and damaged or degenerate input.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "unit/filters/shadow_map_cases.h"

namespace {

using namespace gobo;
using namespace gobo::shadowtest;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

ExponentialCase at(float c, float bias = 0.0f) { return {unitFrame(), c, bias}; }
NodePtr encodeNode(float c, int blur, int resolution) { return makeShadowEncodeNode(makeExponentialBasis(c, false), blur, resolution, 1, false); }

TEST(ExponentialShadow, ConstantMapGivesTheExponentialOfTheGap) {
  std::vector<Vec3> points;
  for (int i = 0; i <= 200; ++i) points.push_back({random01(1, i), random01(2, i), float(i) / 200});
  const TermPtr g = receivers(points);
  for (int blur : {0, 3, 64})
    for (float c : {1.0f, 60.0f, 80.0f}) {
      const TermPtr map = encode(depthMap(17, 17, [](int, int) { return 0.4f; }), c, blur);
      const auto V = values(lookup(g, map, at(c)), "V");
      for (size_t i = 0; i < points.size(); ++i)
        EXPECT_NEAR(V[i], std::min(1.0, std::exp(-double(c) * (double(points[i].z) - 0.4))), 2e-5) << blur << " " << c << " " << points[i].z;
    }
}

TEST(ExponentialShadow, BiasLightsWhatLiesWithinIt) {
  const TermPtr map = encode(depthMap(4, 4, [](int, int) { return 0.5f; }), 60.0f, 0);
  const auto V = values(lookup(receivers({{0.5f, 0.5f, 0.509f}, {0.5f, 0.5f, 0.52f}}), map, at(60.0f, 0.01f)), "V");
  EXPECT_EQ(V[0], 1.0f);
  EXPECT_NEAR(V[1], std::exp(-60.0 * 0.01), 1e-4);
}

TEST(ExponentialShadow, PlanarOccluderOverPlanarReceiver) {
  // Blocker at z = 0.3 over x < 1/2, floor at 0.7: dark below, lit beside, and between them the filtered step, whose closed form
  // is (1 - p) e^{-c g} + p with p the share of the kernel on the lit side, interpolated between texels.
  const int size = 64;
  const float c = 80.0f;
  const TermPtr depth = depthMap(size, size, [](int x, int) { return x < size / 2 ? 0.3f : 0.7f; });
  std::vector<Vec3> points;
  for (int i = 0; i <= 400; ++i) points.push_back({0.05f + 0.9f * float(i) / 400, 0.37f, 0.7f});
  for (int blur : {0, 2, 9}) {
    const auto V = values(lookup(receivers(points), encode(depth, c, blur), at(c)), "V");
    const double sigma = (2 * blur + 1) / 4.0;
    std::vector<double> weight(size_t(2 * blur + 1));
    double sum = 0;
    for (int k = -blur; k <= blur; ++k) sum += weight[size_t(k + blur)] = std::exp(-0.5 * k * k / (sigma * sigma));
    const auto litShare = [&](int x) {
      double p = 0;
      for (int k = -blur; k <= blur; ++k) p += x + k >= size / 2 ? weight[size_t(k + blur)] / sum : 0.0;
      return p;
    };
    for (size_t i = 0; i < points.size(); ++i) {
      const double t = double(points[i].x) * size - 0.5;
      const int x = int(t);
      const double p = litShare(x) * (1 - (t - x)) + litShare(x + 1) * (t - x);
      EXPECT_NEAR(V[i], p + (1 - p) * std::exp(-double(c) * 0.4), 3e-5) << blur << " at " << points[i].x;
      if (i) { EXPECT_GE(V[i], V[i - 1] - 1e-6f) << "not monotone at " << points[i].x; }
    }
    EXPECT_LT(V.front(), 1e-6f);
    EXPECT_NEAR(V.back(), 1.0f, 1e-6f);  // the weights sum to 1 within rounding
  }
}

TEST(ExponentialShadow, PlanarReceiverWithBiasIsExactlyOneBeside) {
  const TermPtr depth = depthMap(64, 64, [](int x, int) { return x < 32 ? 0.3f : 0.7f; });
  const auto V = values(lookup(receivers({{0.9f, 0.5f, 0.7f}, {0.1f, 0.5f, 0.7f}}), encode(depth, 60.0f, 2), at(60.0f, 0.001f)), "V");
  EXPECT_EQ(V[0], 1.0f);
  EXPECT_LT(V[1], 1e-9f);
}

TEST(ExponentialShadow, FilterMatchesBruteForceInDouble) {
  // Includes kernels wider than the map, where every tap beyond repeats the rim.
  struct Case {
    int width, height, blur;
  };
  for (const Case k : {Case{40, 23, 5}, Case{3, 5, 64}, Case{1, 1, 8}, Case{1, 30, 4}, Case{300, 2, 1}}) {
    const auto z = [](int x, int y) { return random01(7, uint64_t(y * 1000 + x)); };
    const float c = 20.0f;
    const auto E = values(encode(depthMap(k.width, k.height, z), c, k.blur), "B");
    const double sigma = (2 * k.blur + 1) / 4.0;
    double worst = 0;
    for (int y = 0; y < k.height; ++y)
      for (int x = 0; x < k.width; x += 3) {
        double sum = 0, weights = 0;
        for (int j = -k.blur; j <= k.blur; ++j)
          for (int i = -k.blur; i <= k.blur; ++i) {
            const double w = std::exp(-0.5 * (i * i + j * j) / (sigma * sigma));
            weights += w;
            sum += w * std::exp(double(c) * (double(z(std::clamp(x + i, 0, k.width - 1), std::clamp(y + j, 0, k.height - 1))) - 1.0));
          }
        worst = std::max(worst, std::fabs(E[size_t(y) * k.width + x] / (sum / weights) - 1.0));
      }
    EXPECT_LT(worst, 1e-5) << k.width << "x" << k.height << " blur " << k.blur;
  }
}

TEST(ExponentialShadow, SlantedPlaneStaysLit) {
  // Thesis 6.4: the Gaussian over a slope m raises s to about e^{(c m sigma)^2 / 2} >= 1, so a lit slope never darkens at texel centres.
  const int size = 32;
  std::vector<Vec3> points;
  for (int x = 8; x < 24; ++x) points.push_back({(float(x) + 0.5f) / size, 0.5f, 0.2f + 0.01f * float(x)});
  const TermPtr depth = depthMap(size, size, [](int x, int) { return 0.2f + 0.01f * float(x); });
  const auto V = values(lookup(receivers(points), encode(depth, 60.0f, 3), at(60.0f)), "V");
  for (float v : V) EXPECT_EQ(v, 1.0f);
}

TEST(ExponentialShadow, NothingOverflowsAtTheLargestExponent) {
  // c = 80 and depths at the far end: e^{c z} itself would sum past FLT_MAX over the kernel (thesis: 6100 texels at z = 1).
  const int size = 140;
  const TermPtr map = encode(depthMap(size, size, [](int x, int y) { return (x + y) % 3 ? 1.0f : random01(3, uint64_t(x * 999 + y)); }), 80.0f, 64);
  for (float e : map->floats("B")) ASSERT_TRUE(std::isfinite(e) && e > 0.0f && e <= 1.0f + 1e-5f) << e;
  std::vector<Vec3> points;
  for (int i = 0; i < 2000; ++i) points.push_back({random01(4, i), random01(5, i), random01(6, i)});
  for (float bias : {0.0f, 1.0f})
    for (float v : values(lookup(receivers(points), map, at(80.0f, bias)), "V"))
      ASSERT_TRUE(v >= bias && v <= 1.0f) << v;  // a bias of the whole range lights everything
}

TEST(ExponentialShadow, DamagedTexelsCountAsNothingHitAndDoNotSpread) {
  for (float bad : {kNan, kInf, -kInf}) {
    const auto z = [](int x, int y) { return 0.2f + 0.5f * random01(8, uint64_t(y * 50 + x)); };
    const auto damaged = [&](int x, int y) { return x == 9 && y == 11 ? bad : z(x, y); };
    const auto repaired = [&](int x, int y) { return x == 9 && y == 11 ? 1.0f : z(x, y); };
    const auto a = values(encode(depthMap(20, 20, damaged), 80.0f, 3), "B"), b = values(encode(depthMap(20, 20, repaired), 80.0f, 3), "B");
    EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * 4), 0) << bad;
  }
  // Depth out of range is cut, so that 1e31 cannot appear (the classic EVSM explosion).
  const auto wild = values(encode(depthMap(8, 8, [](int x, int) { return x == 4 ? 1e30f : -1e30f; }), 80.0f, 2), "B");
  const auto cut = values(encode(depthMap(8, 8, [](int x, int) { return x == 4 ? 1.0f : 0.0f; }), 80.0f, 2), "B");
  EXPECT_EQ(wild, cut);
  EXPECT_LT(cut[0], 1e-30f);
}

TEST(ExponentialShadow, DamagedMapGivesLitReceivers) {
  const TermPtr map = basisMap(2, 1, [](int x, int, int) { return x == 0 ? kNan : 1e-35f; });
  const auto V = values(lookup(receivers({{0.1f, 0.5f, 0.9f}, {0.5f, 0.5f, 0.9f}, {0.9f, 0.5f, 0.9f}}), map, at(60.0f)), "V");
  EXPECT_EQ(V[0], 1.0f);
  EXPECT_EQ(V[1], 1.0f);
  EXPECT_TRUE(V[2] >= 0.0f && V[2] <= 1.0f);
}

TEST(ExponentialShadow, ReceiversOutsideTheDepthRangeAreReadAtItsEnds) {
  const TermPtr map = encode(depthMap(4, 4, [](int, int) { return 0.9f; }), 80.0f, 0);
  const auto V = values(lookup(receivers({{0.5f, 0.5f, 1.0f}, {0.5f, 0.5f, 7.0f}, {0.5f, 0.5f, -7.0f}}), map, at(80.0f)), "V");
  EXPECT_NEAR(V[0], std::exp(-8.0), 1e-6);
  EXPECT_EQ(V[1], V[0]);
  EXPECT_EQ(V[2], 1.0f);
}

TEST(ExponentialShadow, RimOfTheMapIsNotExtrapolated) {
  const auto z = [](int x, int y) { return 0.5f + 0.05f * float(x) + 0.01f * float(y); };
  const TermPtr map = encode(depthMap(4, 4, z), 10.0f, 0);
  const auto V = values(lookup(receivers({{0.0f, 0.0f, 0.8f}, {1.0f, 1.0f, 0.8f}, {0.125f, 0.125f, 0.8f}}), map, at(10.0f)), "V");
  EXPECT_NEAR(V[0], std::exp(10.0 * (z(0, 0) - 0.8)), 1e-6);
  EXPECT_NEAR(V[1], std::exp(10.0 * (z(3, 3) - 0.8)), 1e-6);
  EXPECT_EQ(V[2], V[0]);
}

TEST(ExponentialShadow, DamagedReceiversAndEmptyPixelsAreLit) {
  const TermPtr map = encode(depthMap(8, 8, [](int, int) { return 0.0f; }), 60.0f, 1);
  auto term = std::make_shared<Term>("gbuffer", Domain::ViewSample, Extent{4, 1, 1});
  auto P = term->addPlane<float>("P", 3);
  auto instance = term->addPlane<uint32_t>("instance");
  const Vec3 points[4] = {{kNan, 0.5f, 0.9f}, {0.5f, kInf, 0.9f}, {0.5f, 0.5f, 0.9f}, {0.5f, 0.5f, 0.9f}};
  for (int i = 0; i < 4; ++i)
    for (int k = 0; k < 3; ++k) P[3 * i + k] = points[i][k];
  instance[3] = ~0u;
  const auto V = values(lookup(term, map, at(60.0f)), "V");
  EXPECT_EQ(V[0], 1.0f);
  EXPECT_EQ(V[1], 1.0f);
  EXPECT_LT(V[2], 1e-6f);  // the sound receiver is dark
  EXPECT_EQ(V[3], 1.0f);
}

TEST(ExponentialShadow, DegenerateMaps) {
  const TermPtr g = receivers({{0.5f, 0.5f, 0.9f}, {0.01f, 0.99f, 0.9f}});
  const auto empty = values(lookup(g, encode(depthMap(0, 0, [](int, int) { return 0.0f; }), 60.0f, 2), at(60.0f)), "V");
  EXPECT_EQ(empty, (std::vector<float>{1.0f, 1.0f}));
  const auto one = values(lookup(g, encode(depthMap(1, 1, [](int, int) { return 0.2f; }), 60.0f, 2), at(60.0f)), "V");
  for (float v : one) EXPECT_NEAR(v, std::exp(-60.0 * 0.7), 1e-6);
  const auto nothing = values(lookup(g, encode(depthMap(16, 16, [](int, int) { return 1.0f; }), 60.0f, 2), at(60.0f, 0.001f)), "V");
  EXPECT_EQ(nothing, (std::vector<float>{1.0f, 1.0f}));  // the light sees nothing
  const TermPtr none = lookup(receivers({}), encode(depthMap(4, 4, [](int, int) { return 0.2f; }), 60.0f, 0), at(60.0f));
  EXPECT_EQ(none->floats("V").size(), 0u);
}

TEST(ExponentialShadow, OutsideTheMapIsLit) {
  const TermPtr map = encode(depthMap(8, 8, [](int, int) { return 0.0f; }), 60.0f, 0);
  const auto V = values(
      lookup(receivers({{-0.01f, 0.5f, 0.9f}, {1.01f, 0.5f, 0.9f}, {0.5f, -0.01f, 0.9f}, {0.5f, 1.01f, 0.9f}, {0.99f, 0.99f, 0.9f}}), map, at(60.0f)), "V");
  EXPECT_EQ((std::vector<float>{V.begin(), V.begin() + 4}), std::vector<float>(4, 1.0f));
  EXPECT_LT(V[4], 1e-6f);
  // Perspective: a point behind the light projects into the window, but lies on the wrong side.
  LightFrame f = unitFrame();
  f.perspective = true;
  f.lo = Vec2(-1.0f);
  f.hi = Vec2(1.0f);
  f.far = 10.0f;
  const auto W = values(lookup(receivers({{0, 0, -5}, {0, 0, 5}, {0, 0, 0}, {6, 0, 5}}), map, {f, 60.0f, 0.0f}), "V");
  EXPECT_EQ(W[0], 1.0f);
  EXPECT_LT(W[1], 1e-6f);
  EXPECT_EQ(W[2], 1.0f);
  EXPECT_EQ(W[3], 1.0f);
}

TEST(ExponentialShadow, SameBitsForAnyNumberOfThreads) {
  std::vector<Vec3> points;
  for (int i = 0; i < 40000; ++i) points.push_back({random01(11, i), random01(12, i), random01(13, i)});
  const TermPtr g = receivers(points), depth = depthMap(150, 150, [](int x, int y) { return random01(14, uint64_t(y * 500 + x)); });
  const TermPtr a = lookup(g, encode(depth, 70.0f, 4, 1), at(70.0f), 1), b = lookup(g, encode(depth, 70.0f, 4, 2), at(70.0f), 2);
  EXPECT_EQ(a->content(), b->content());
}

TEST(ExponentialShadow, DepthRangeScalesWithTheExponent) {
  // Halving the range (doubling distances in it) with half the exponent is the same picture.
  const auto run = [](float c, float scale) {
    const TermPtr map = encode(depthMap(16, 16, [&](int x, int y) { return scale * (0.1f + 0.3f * random01(15, uint64_t(y * 16 + x))); }), c, 2);
    std::vector<Vec3> points;
    for (int i = 0; i < 100; ++i) points.push_back({random01(16, i), random01(17, i), scale * 0.4f});
    return values(lookup(receivers(points), map, at(c)), "V");
  };
  const auto a = run(80.0f, 1.0f), b = run(40.0f, 2.0f);
  for (size_t i = 0; i < a.size(); ++i) EXPECT_NEAR(a[i], b[i], 2e-5);
}

TEST(ExponentialShadow, StopsWhenTold) {
  StopSource source;
  source.stop(StopReason::Cancelled);
  TaskArena arena(1);
  RunContext ctx;
  ctx.arena = &arena;
  ctx.stop = source.token();
  ctx.inputs = {depthMap(32, 32, [](int, int) { return 0.5f; })};
  const auto result = runNode(*encodeNode(60.0f, 2, 32), ctx);
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.status().code(), Code::Cancelled);
}

TEST(ExponentialShadow, KeysFollowParameters) {
  const auto digest = [](const NodePtr& n) {
    Hasher h(n->type());
    n->hashParameters(h);
    return h.digest();
  };
  EXPECT_EQ(digest(encodeNode(60, 2, 64)), digest(encodeNode(60, 2, 64)));
  EXPECT_NE(digest(encodeNode(60, 2, 64)), digest(encodeNode(61, 2, 64)));
  EXPECT_NE(digest(encodeNode(60, 2, 64)), digest(encodeNode(60, 3, 64)));
  LightFrame moved = unitFrame();
  moved.origin.x = 1e-3f;
  EXPECT_NE(digest(exponentialLookupNode(at(60), 8)), digest(exponentialLookupNode({moved, 60, 0}, 8)));
  EXPECT_NE(digest(exponentialLookupNode(at(60), 8)), digest(exponentialLookupNode(at(60, 0.1f), 8)));
  EXPECT_NE(digest(exponentialLookupNode(at(60), 8)), digest(exponentialLookupNode(at(61), 8)));
  EXPECT_NE(digest(makeLightDepthMapNode(oneFace(unitFrame()), 64)), digest(makeLightDepthMapNode(oneFace(unitFrame()), 65)));
  EXPECT_NE(digest(makeLightDepthMapNode(oneFace(unitFrame()), 64)), digest(makeLightDepthMapNode(oneFace(moved), 64)));
}

TEST(ExponentialShadowDeathTest, ExponentsThatLeaveFloatAreProgrammerErrors) { EXPECT_DEATH(makeExponentialBasis(88.0f, false), "CHECK failed"); }

}  // namespace

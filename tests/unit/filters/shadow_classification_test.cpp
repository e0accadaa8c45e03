// SPDX-License-Identifier: Apache-2.0
// Where the exponential map's assumption fails (Annen 2008, 7.3): the two classifications against a search of the kernel, and what is done
// about it. Violation: some depth in the kernel lies further than a margin behind the receiver.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "unit/filters/shadow_map_cases.h"

namespace {

using namespace gobo;
using namespace gobo::shadowtest;
using Exponential = v1::ExponentialShadow;
using Settings = v1::ShadowMapSettings;

struct Marked {
  std::vector<float> V, flags;
};

Marked classify(const TermPtr& depth, const TermPtr& g, float c, int blur, Exponential::Classification how, float epsilon, bool kernel = true,
                float slopeBias = 0.0f) {
  const ShadowBasisPtr basis = makeExponentialBasis(c, c > 80);
  ShadowLookup l = unitLookup(depth->extent().width, blur);
  l.classification = how;
  l.epsilon = epsilon;
  l.fallbackKernel = kernel;
  l.map.slopeBias = slopeBias;
  const TermPtr t = lookupBasis(g, encodeBasis(depth, basis, blur), basis, l, depthBounds(depth));
  return {values(t, "V"), values(t, "flags")};
}

// Blobs of depth over a far floor, receivers on and above it.
constexpr int kSide = 61;  // not a power of two: the pyramid's last texels cover less
float blobs(int x, int y) { return random01(61, uint64_t(y / 5 * 100 + x / 5)) < 0.35f ? 0.3f + 0.3f * random01(62, uint64_t(y / 5 * 100 + x / 5)) : 0.8f; }
std::vector<Vec3> somewhere(int n) {
  std::vector<Vec3> points;
  for (int i = 0; i < n; ++i) points.push_back({random01(63, uint64_t(i)), random01(64, uint64_t(i)), 0.25f + 0.6f * random01(65, uint64_t(i))});
  return points;
}
/// Largest depth among texels that the bilinear lookup of the filtered map gives weight to.
float deepest(const Vec3& p, int blur) {
  const auto t = [](float u) { return formulas::shadowTexel(u, float(kSide)); };
  float hi = 0;
  const int x = int(t(p.x)), y = int(t(p.y));
  const int right = t(p.x) > float(x), below = t(p.y) > float(y);
  for (int j = y - blur; j <= y + blur + below; ++j)
    for (int i = x - blur; i <= x + blur + right; ++i) hi = std::max(hi, blobs(std::clamp(i, 0, kSide - 1), std::clamp(j, 0, kSide - 1)));
  return hi;
}

TEST(ShadowClassification, ZMaxMissesNothing) {
  const TermPtr depth = depthMap(kSide, blobs);
  const auto points = somewhere(20000);
  for (int blur : {0, 1, 2, 3, 9, 20})
    for (float epsilon : {0.0f, 0.05f, 1.0f}) {
      const float c = 80;
      const Marked m = classify(depth, receivers(points), c, blur, Exponential::Z_MAX, epsilon);
      int violated = 0, found = 0, flagged = 0;
      for (size_t i = 0; i < points.size(); ++i) {
        const bool truth = deepest(points[i], blur) > points[i].z + epsilon / c + 1e-6f;
        violated += truth;
        found += truth && m.flags[i] == 1.0f;
        flagged += m.flags[i] == 1.0f;
        ASSERT_TRUE(m.flags[i] == 0.0f || m.flags[i] == 1.0f);
      }
      EXPECT_EQ(found, violated) << "recall below 1 at blur " << blur;
      EXPECT_GT(violated, 1000);
      // Precision: a texel more on an axis where the receiver is at a texel's centre. Kernels above 1024 texels take the pyramid's word.
      EXPECT_GT(double(violated) / flagged, blur == 20 ? 0.9 : 0.999) << blur;
    }
}

TEST(ShadowClassification, ASlantedPlaneIsNotBehindItself) {
  // The pyramid's bounds are of up to twice the kernel; without the search of the kernel itself about half of these are flagged.
  for (const Vec2& slope : {Vec2(0.5f, -0.3f), Vec2(0.0f, 0.6f), Vec2(-0.2f, -0.1f)}) {
    const auto plane = [&](float u, float v) { return 0.5f + slope.x * (u - 0.5f) + slope.y * (v - 0.5f); };
    const TermPtr depth = depthMap(kSide, [&](int x, int y) { return plane((float(x) + 0.5f) / kSide, (float(y) + 0.5f) / kSide); });
    std::vector<Vec3> points = somewhere(4000);
    for (Vec3& p : points) {
      p.x = 0.02f + 0.96f * p.x, p.y = 0.02f + 0.96f * p.y;  // not outside the outermost texels' centres, where the map does not go on
      p.z = plane(p.x, p.y);
    }
    for (int blur : {0, 1, 2, 3, 9, 15}) {
      const Marked m = classify(depth, receivers(points, glm::normalize(Vec3(slope, -1.0f))), 80, blur, Exponential::Z_MAX, 0.05f, true, 1.0f);
      int flagged = 0;
      for (const float f : m.flags) flagged += f != 0.0f;
      EXPECT_EQ(flagged, 0) << "blur " << blur << " slope " << slope.x << "," << slope.y;
    }
  }
}

TEST(ShadowClassification, ZMaxMissesNothingUnderMinification) {
  // Coarser lookups reach further: every texel of level 0 that the trilinear or anisotropic lookup weighs counts. Found out by moving each
  // texel of the map and looking whether the lookup notices (linear in the map, so any weight shows).
  const int size = 32;
  const ShadowBasisPtr basis = makeExponentialBasis(20, false);
  const std::vector<Vec3> points{{0.5f, 0.5f, 0.6f}, {0.07f, 0.31f, 0.6f}, {0.77f, 0.93f, 0.6f}, {0.4f, 0.61f, 0.6f}, {0.999f, 0.001f, 0.6f}};
  for (const auto lookup : {Settings::TRILINEAR, Settings::ANISOTROPIC})
    for (float width : {0.01f, 0.05f, 0.11f, 0.3f})
      for (const Vec3& normal : {Vec3(0, 0, -1), glm::normalize(Vec3(3, 1, -1))}) {
        const TermPtr g = receivers(points, normal, width);
        ShadowLookup l = unitLookup(size);
        l.map.lookup = lookup;
        l.epsilon = 0;
        for (int ty = 0; ty < size; ty += 3)
          for (int tx = 0; tx < size; tx += 2) {
            const TermPtr depth = depthMap(size, [&](int x, int y) { return x == tx && y == ty ? 0.9f : 0.1f; });
            const TermPtr chain = runNode(makeShadowMipmapNode(basis, size, 1, false), {encodeBasis(depth, basis, 0)}, 1);
            ShadowLookup z = l;
            z.classification = Exponential::Z_MAX;
            const auto plain = values(lookupBasis(g, chain, basis, l, nullptr, 1), "V");
            const auto flags = values(lookupBasis(g, chain, basis, z, depthBounds(depth, 1), 1), "flags");
            for (size_t i = 0; i < points.size(); ++i)
              if (plain[i] > 4.55e-5f * 1.001f) {
                ASSERT_EQ(flags[i], 1.0f) << "texel " << tx << "," << ty << " point " << i << " width " << width << " lookup " << lookup;  // e^{-20 / 2}
              }
          }
      }
}

TEST(ShadowClassification, ThresholdIsPreciseAndItsRecallFallsWithEpsilon) {
  // s > 1 + eps needs some z > d + ln(1 + eps) / c: precision is 1 by that margin. What blockers hide is missed: recall, printed.
  const TermPtr depth = depthMap(kSide, blobs);
  const auto points = somewhere(20000);
  const float c = 80;
  for (int blur : {0, 1, 2, 3}) {
    double last = 2;
    for (float epsilon : {0.01f, 0.05f, 0.2f, 1.0f}) {
      const Marked m = classify(depth, receivers(points), c, blur, Exponential::THRESHOLD, epsilon);
      int violated = 0, flagged = 0, right = 0;
      for (size_t i = 0; i < points.size(); ++i) {
        const bool truth = deepest(points[i], blur) > points[i].z + std::log1p(epsilon) / c - 1e-6f;
        violated += truth;
        flagged += m.flags[i] == 1.0f;
        right += truth && m.flags[i] == 1.0f;
      }
      const double recall = double(right) / violated;
      std::cout << "blur " << blur << " eps " << epsilon << ": threshold precision " << double(right) / flagged << " recall " << recall << ", flagged "
                << 100.0 * flagged / double(points.size()) << " %" << std::endl;
      EXPECT_EQ(right, flagged) << "a pixel without violation was flagged";
      EXPECT_GT(recall, 0.9) << blur << " " << epsilon;
      EXPECT_LE(recall, last + 0.01);
      last = recall;
    }
  }
}

TEST(ShadowClassification, FlaggedPixelsAreComparedAndOthersAreNot) {
  const TermPtr depth = depthMap(kSide, blobs);
  const auto points = somewhere(5000);
  const TermPtr g = receivers(points);
  for (const auto how : {Exponential::Z_MAX, Exponential::THRESHOLD})
    for (int blur : {0, 2, 5})
      for (float c : {60.0f, 200.0f})
        for (bool kernel : {true, false}) {
          const Marked m = classify(depth, g, c, blur, how, 0.05f, kernel);
          const auto same = compare(depth, unitComparison(kSide, v1::PercentageCloserShadow::GAUSSIAN, kernel ? blur : 0), g);
          const auto plain = visibility(depth, makeExponentialBasis(c, c > 80), blur, points);
          for (size_t i = 0; i < points.size(); ++i) ASSERT_EQ(m.V[i], m.flags[i] == 1.0f ? same[i] : plain[i]) << how << " " << blur << " " << i;
        }
}

TEST(ShadowClassification, LitSlantedPlanesAreNoFailures) {
  // Under a kernel of 7 texels this slope overshoots by x^2 / 2 = 0.6 (6.4): a bare threshold of 1.05 would flag the whole plane, a Z-Max without
  // the plane's own span too, and one read from the pyramid alone in stripes. A hole in it is a failure for both, where the kernel sees it.
  const int size = 64, blur = 3;
  const float m = 0.008f;
  for (const auto how : {Exponential::Z_MAX, Exponential::THRESHOLD}) {
    std::vector<Vec3> points;
    for (int i = 0; i < 4000; ++i) {
      const float x = 0.1f + 0.8f * random01(67, uint64_t(i)), y = 0.1f + 0.8f * random01(68, uint64_t(i));
      points.push_back({x, y, 0.2f + m * (x * size - 0.5f)});
    }
    const ShadowBasisPtr basis = makeExponentialBasis(80, false);
    ShadowLookup l = unitLookup(size, blur);
    l.map.slopeBias = 1.0f;
    l.classification = how;
    const TermPtr g = receivers(points, glm::normalize(Vec3(m * size, 0, -1)));
    for (bool hole : {false, true}) {
      const TermPtr depth = depthMap(size, [&](int x, int y) { return hole && std::abs(x - 40) < 2 && std::abs(y - 20) < 2 ? 1.0f : 0.2f + m * float(x); });
      const auto flags = values(lookupBasis(g, encodeBasis(depth, basis, blur), basis, l, depthBounds(depth)), "flags");
      int flagged = 0, near = 0, far = 0;
      for (size_t i = 0; i < points.size(); ++i) {
        const float x = points[i].x * size - 40.5f, y = points[i].y * size - 20.5f;
        flagged += flags[i] == 1.0f;
        if (std::max(std::fabs(x), std::fabs(y)) < 1.0f) near += flags[i] == 0.0f;
        if (std::max(std::fabs(x), std::fabs(y)) > float(blur) + 3.0f) far += flags[i] == 1.0f;
      }
      EXPECT_EQ(far, 0) << how;
      EXPECT_EQ(flagged > 0, hole) << how;
      if (hole) { EXPECT_EQ(near, 0) << how; }
    }
  }
}

TEST(ShadowClassification, LeakBehindABlockersEdgeIsRepaired) {
  // A card at 0.3 over half of a floor at 0.8, and a box top at 0.5 below the card: its receivers see floor depths in the kernel and light
  // up (thesis, figure 7.2a). Compared, they are as dark as percentage-closer has them.
  const int size = 64, blur = 3;
  const TermPtr depth = depthMap(size, [](int x, int) { return x < 32 ? 0.3f : 0.8f; });
  std::vector<Vec3> points;
  for (int i = 0; i < 3; ++i) points.push_back({(31.5f - float(i)) / 64, 0.5f, 0.5f});  // below the card, 0 to 2 texels from its edge
  const auto plain = visibility(depth, makeExponentialBasis(80, false), blur, points);
  const auto truth = compare(depth, unitComparison(size, v1::PercentageCloserShadow::GAUSSIAN, blur), receivers(points));
  const Marked m = classify(depth, receivers(points), 80, blur, Exponential::THRESHOLD, 0.05f);
  for (size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(plain[i], 1.0f) << "the case lost its leak";
    EXPECT_LT(truth[i], 0.5f);
    EXPECT_EQ(m.V[i], truth[i]);
  }
}

}  // namespace

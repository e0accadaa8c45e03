// SPDX-License-Identifier: Apache-2.0
// Contours of hard shadows: where they are, how long they are in the world, and where they end.
#include <gtest/gtest.h>

#include <cmath>

#include "filters/stylised/contour.h"
#include "unit/filters/synthetic.h"

namespace gobo {
namespace {

using namespace test;

const float kCosine = std::cos(kPi / 4);

std::vector<ContourSegment> segmentsOf(const Term& V, const Term& g, int threads = 2) {
  ContourInput in;
  in.width = V.extent().width;
  in.height = V.extent().height;
  in.channels = V.channels("V");
  in.V = V.floats("V");
  in.P = g.floats("P");
  in.N = g.floats("N");
  in.Ng = g.floats("Ng");
  in.footprint = g.floats("footprint");
  in.instance = g.plane<uint32_t>("instance");
  const TaskArena arena(threads);
  auto r = extractContour(in, kCosine, arena, {});
  EXPECT_TRUE(r.ok());
  return *r;
}
double lengthOf(const std::vector<ContourSegment>& contour) {
  double sum = 0;
  for (const ContourSegment& s : contour) sum += double(glm::length(s.b - s.a));
  return sum;
}
PlaneView view(int width, int height) {
  PlaneView v;
  v.width = width;
  v.height = height;
  return v;
}

TEST(StyleContour, AStraightEdgeLiesHalfWayAndHasItsLength) {
  const Extent e{20, 11, 1};
  const auto g = planeGBuffer(view(20, 11));
  const auto contour = segmentsOf(*floatTerm(e, "V", [](int x, int, int) { return x < 8 ? 0.0f : 1.0f; }), *g);
  ASSERT_EQ(contour.size(), 10u);
  for (const ContourSegment& s : contour) {
    EXPECT_FLOAT_EQ(s.a.x, 0.75f);
    EXPECT_FLOAT_EQ(s.b.x, 0.75f);
    EXPECT_EQ(s.normal, Vec3(0, 0, 1));
  }
  EXPECT_NEAR(lengthOf(contour), 1.0, 1e-6);
}

TEST(StyleContour, ADiagonalIsNoStaircase) {
  const Extent e{33, 33, 1};
  const auto contour = segmentsOf(*floatTerm(e, "V", [](int x, int y, int) { return x < y ? 0.0f : 1.0f; }), *planeGBuffer(view(33, 33)));
  EXPECT_NEAR(lengthOf(contour), 0.1 * std::sqrt(2.0) * 31.5, 0.1);
}

TEST(StyleContour, LengthIsOfTheWorld) {  // the plane is seen so that a pixel down is three across
  PlaneView v = view(16, 16);
  v.dv = Vec3(0, 0, 0.3f);
  v.normal = Vec3(0, 1, 0);
  const auto down = segmentsOf(*floatTerm({16, 16, 1}, "V", [](int x, int, int) { return x < 8 ? 0.0f : 1.0f; }), *planeGBuffer(v));
  const auto across = segmentsOf(*floatTerm({16, 16, 1}, "V", [](int, int y, int) { return y < 8 ? 0.0f : 1.0f; }), *planeGBuffer(v));
  EXPECT_NEAR(lengthOf(down), 4.5, 1e-5);
  EXPECT_NEAR(lengthOf(across), 1.5, 1e-5);
}

TEST(StyleContour, ASoftEdgeLiesWhereHalfOfTheLightArrives) {
  const auto contour = segmentsOf(*floatTerm({8, 4, 1}, "V", [](int x, int, int) { return x < 3 ? 0.0f : x == 3 ? 0.4f : 0.9f; }), *planeGBuffer(view(8, 4)));
  ASSERT_EQ(contour.size(), 3u);
  for (const ContourSegment& s : contour) EXPECT_NEAR(s.a.x, 0.32f, 1e-6f);  // 3 + (0.5 - 0.4) / (0.9 - 0.4) pixels
}

TEST(StyleContour, CutWhereThePictureEndsAShadowAndNotTheSurface) {
  const Extent e{16, 9, 1};
  const auto V = floatTerm(e, "V", [](int x, int, int) { return x < 8 ? 0.0f : 1.0f; });
  const auto edited = [&](const std::function<void(Term&, size_t)>& edit) {
    auto g = planeGBuffer(view(16, 9));
    for (int y = 0; y < 9; ++y)
      for (int x = 8; x < 16; ++x) edit(*g, size_t(y * 16 + x));
    return segmentsOf(*V, *g).size();
  };
  EXPECT_EQ(edited([](Term&, size_t) {}), 8u);
  EXPECT_EQ(edited([](Term& g, size_t i) { g.writable<uint32_t>("instance")[i] = 1; }), 0u) << "another mesh";
  EXPECT_EQ(edited([](Term& g, size_t i) { g.writable<uint32_t>("instance")[i] = ~0u; }), 0u) << "nothing";
  EXPECT_EQ(edited([](Term& g, size_t i) { g.writable<float>("P")[3 * i + 2] = -0.5f; }), 0u) << "a step in depth on one mesh";
  EXPECT_EQ(edited([](Term& g, size_t i) { g.writable<float>("N")[3 * i] = 0.8f, g.writable<float>("N")[3 * i + 2] = 0.6f; }), 0u) << "a crease of 53 degrees";
  EXPECT_EQ(edited([](Term& g, size_t i) { g.writable<float>("N")[3 * i] = 0.6f, g.writable<float>("N")[3 * i + 2] = 0.8f; }), 8u) << "one of 37";
}

TEST(StyleContour, AGrazingPlaneIsOneSurface) {
  PlaneView v = view(16, 16);
  v.dv = Vec3(0, 0, 40.0f);  // a pixel's width is 0.1
  v.normal = Vec3(0, 1, 0);
  EXPECT_EQ(segmentsOf(*floatTerm({16, 16, 1}, "V", [](int, int y, int) { return y < 8 ? 0.0f : 1.0f; }), *planeGBuffer(v)).size(), 15u);
}

TEST(StyleContour, ShadowsThatTouchByCornersAreConnected) {
  for (const bool turned : {false, true}) {
    const auto V = floatTerm({2, 2, 1}, "V", [&](int x, int y, int) { return ((x + y) % 2 == 0) == turned ? 1.0f : 0.0f; });
    const auto contour = segmentsOf(*V, *planeGBuffer(view(2, 2)));
    ASSERT_EQ(contour.size(), 2u);
    for (const ContourSegment& s : contour) {  // each cuts off a lit corner
      const Vec3 m = 0.5f * (s.a + s.b);
      float nearest = 1, lit = 0;
      for (int k = 0; k < 4; ++k) {
        const float d = glm::length(m - 0.1f * Vec3(float(k % 2), float(k / 2), 0));
        if (d < nearest) nearest = d, lit = V->floats("V")[size_t(k)];
      }
      EXPECT_EQ(lit, 1.0f);
      EXPECT_NEAR(nearest, 0.1 * std::sqrt(2.0) / 4, 1e-6);
    }
  }
}

TEST(StyleContour, AllSixteenSquaresPartLitFromShadow) {
  for (int code = 0; code < 16; ++code) {
    const auto V = floatTerm({2, 2, 1}, "V", [&](int x, int y, int) { return (code >> (2 * y + x)) & 1 ? 1.0f : 0.0f; });
    const auto contour = segmentsOf(*V, *planeGBuffer(view(2, 2)));
    int sides = 0;
    for (const auto& [k, l] : {std::pair{0, 1}, {1, 3}, {3, 2}, {2, 0}}) sides += (code >> k & 1) != (code >> l & 1);
    EXPECT_EQ(contour.size(), size_t(sides / 2)) << code;
    for (const ContourSegment& s : contour)
      for (const Vec3& end : {s.a, s.b}) {  // every end is the middle of a side between a lit corner and one in shadow
        int found = 0;
        for (const auto& [k, l] : {std::pair{0, 1}, {1, 3}, {3, 2}, {2, 0}}) {
          const Vec3 mid = 0.05f * Vec3(float(k % 2 + l % 2), float(k / 2 + l / 2), 0);
          found += (code >> k & 1) != (code >> l & 1) && glm::length(mid - end) < 1e-6f;
        }
        EXPECT_EQ(found, 1) << code;
      }
  }
}

TEST(StyleContour, NothingToParts) {
  for (const float v : {0.0f, 1.0f}) EXPECT_TRUE(segmentsOf(*floatTerm({7, 5, 1}, "V", [&](int, int, int) { return v; }), *planeGBuffer(view(7, 5))).empty());
  for (const auto& [w, h] : {std::pair{1, 1}, {1, 9}, {9, 1}})
    EXPECT_TRUE(segmentsOf(*floatTerm({w, h, 1}, "V", [](int x, int y, int) { return float((x + y) % 2); }), *planeGBuffer(view(w, h))).empty());
}

TEST(StyleContour, TheSameForAnyNumberOfThreads) {
  const Extent e{61, 77, 1};
  const auto V = noiseTerm(e, "V", 5);
  const auto one = segmentsOf(*V, *planeGBuffer(view(61, 77)), 1), four = segmentsOf(*V, *planeGBuffer(view(61, 77)), 4);
  ASSERT_EQ(one.size(), four.size());
  ASSERT_GT(one.size(), 1000u);
  for (size_t k = 0; k < one.size(); ++k) ASSERT_TRUE(one[k].a == four[k].a && one[k].b == four[k].b && one[k].normal == four[k].normal);
}

}  // namespace
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Targets of shadows: distances to simple shapes, pieces and their moments, fixed points, what keeps apart.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <random>

#include "filters/stylised/distance_field.h"
#include "filters/stylised/pieces.h"
#include "filters/stylised/target.h"
#include "unit/filters/synthetic.h"

namespace gobo {
namespace stylised_target_test {

using namespace test;

PlaneView view(const Extent& e, float pixel = 1.0f) {
  PlaneView v;
  v.width = e.width, v.height = e.height, v.layers = e.layers;
  v.du = Vec3(pixel, 0, 0), v.dv = Vec3(0, pixel, 0);
  return v;
}
std::shared_ptr<Term> shadow(const Extent& e, const std::function<bool(double x, double y)>& dark) {  // hard distances: half a unit
  return floatTerm(e, "D", [&](int x, int y, int) { return dark(x, y) ? -0.5f : 0.5f; });
}
TermPtr targeted(const Extent& e, const TermPtr& D, const TermPtr& g, float target, float angularity, int threads = 2, float angle = kPi / 4) {
  return runFilter(makeStyleTargetNode({e, target, angularity, angle}), {D, g}, threads);
}
ShadowPieces piecesOf(const TermPtr& D, const TermPtr& g, double angularity = 0) {
  const TaskArena arena(1);
  const ContourInput in = surfaceInput(*g, 0);
  const auto links = SurfaceLinks::of(in, std::cos(kPi / 4) - kRoundedCosine, arena, {});
  return *shadowPieces(in, *links, D->floats("D"), angularity, {});
}

/// Distance to a polyline of n points of the boundary, negative inside.
double polylineDistance(double A, double B, double a, double u, double v, int n) {
  const double q = 2 / (1 - a);
  u = std::abs(u), v = std::abs(v);
  double best = HUGE_VAL, x0 = A, y0 = 0;
  for (int k = 1; k <= n; ++k) {
    const double x = A * std::pow(std::max(std::cos(0.5 * M_PI * k / n), 0.0), 2 / q), y = B * std::pow(std::sin(0.5 * M_PI * k / n), 2 / q);
    const double dx = x - x0, dy = y - y0, t = std::clamp(((u - x0) * dx + (v - y0) * dy) / std::max(dx * dx + dy * dy, 1e-300), 0.0, 1.0);
    best = std::min(best, std::hypot(u - x0 - t * dx, v - y0 - t * dy));
    x0 = x, y0 = y;
  }
  return std::pow(u / A, q) + std::pow(v / B, q) <= 1 ? -best : best;
}

TEST(TargetShape, DistanceIsThatToTheBoundary) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> unit(0, 1);
  double most = 0;
  for (int k = 0; k < 300; ++k) {
    const double A = 1, B = std::pow(10.0, -2 * unit(random)), a = k % 3 ? 0.9 * unit(random) : 0.0;
    const TargetShape shape(A, B, a);
    for (int j = 0; j < 5; ++j) {
      const double u = 3 * unit(random) - 1.5, v = (3 * unit(random) - 1.5) * (j % 2 ? 1 : B);
      most = std::max(most, std::abs(shape.distance(u, v) - polylineDistance(A, B, a, u, v, 4000)));
    }
  }
  EXPECT_LT(most, 3e-6);
}

TEST(TargetShape, ClosedForms) {
  const TargetShape circle(2, 2, 0), box(3, 1, 1);
  EXPECT_NEAR(circle.distance(0, 0), -2, 1e-12);
  EXPECT_NEAR(circle.distance(3, -4), 3, 1e-9);
  EXPECT_NEAR(circle.distance(0.5, 0.2), std::hypot(0.5, 0.2) - 2, 1e-9);
  EXPECT_EQ(box.distance(0, 0), -1);
  EXPECT_EQ(box.distance(-6, 5), 5);
  EXPECT_EQ(box.distance(2.5, 0.2), -0.5);
  EXPECT_EQ(box.distance(0, -3), 2);
  const TargetShape flat(1, 1e-6, 0);
  EXPECT_NEAR(flat.distance(0.3, 0.4), 0.4, 1e-5);
  EXPECT_NEAR(flat.distance(1.3, 0.4), 0.5, 1e-5);
  for (const double a : {0.0, 0.3, 0.7, 0.99, 1.0}) {  // on the axes and beyond, where slopes are not smooth
    const TargetShape s(2, 1, a);
    EXPECT_NEAR(s.distance(5, 0), 3, 1e-9) << a;
    EXPECT_NEAR(s.distance(0, 4), 3, 1e-9) << a;
    for (const double x : {1e-300, 1e-12, 1e12})
      EXPECT_TRUE(std::isfinite(s.distance(x, 0)) && std::isfinite(s.distance(0, x)) && std::isfinite(s.distance(x, x))) << a;
  }
}

TEST(TargetShape, HasTheAreaAndTheRatioThatItIsAskedFor) {
  EXPECT_NEAR(TargetShape::areaOf(2, 3, 0), 6 * M_PI, 1e-12);
  EXPECT_NEAR(TargetShape::areaOf(2, 3, 1), 24, 1e-12);
  for (const double a : {0.0, 0.2, 0.5, 0.8, 1.0}) {
    const TargetShape s = TargetShape::ofArea(5, 3, 2, a);
    EXPECT_NEAR(s.A() / s.B(), 1.5, 1e-12);
    double inside = 0;
    const int n = 400;
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x) inside += s.distance(4 * (x + 0.5) / n - 2, 4 * (y + 0.5) / n - 2) < 0 ? 16.0 / n / n : 0;
    EXPECT_NEAR(inside, 5, 0.02) << a;
  }
}

struct Frame2 {
  double cx, cy, c, s;
  double u(double x, double y) const { return c * (x - cx) + s * (y - cy); }
  double v(double x, double y) const { return c * (y - cy) - s * (x - cx); }
};
Frame2 turned(double cx, double cy, double degrees) { return {cx, cy, std::cos(degrees * M_PI / 180), std::sin(degrees * M_PI / 180)}; }

std::vector<float> plane(const TermPtr& t) {
  const auto D = t->floats("D");
  return {D.begin(), D.end()};
}

/// Samples farther than `band` from the shape's own edge whose side differs.
size_t wrongSides(const TermPtr& D, const Extent& e, const TargetShape& shape, const Frame2& f, double band) {
  size_t wrong = 0;
  for (int y = 0; y < e.height; ++y)
    for (int x = 0; x < e.width; ++x) {
      const double exact = shape.distance(f.u(x, y), f.v(x, y));
      wrong += std::abs(exact) > band && (exact < 0) != (D->floats("D")[size_t(y * e.width + x)] < 0);
    }
  return wrong;
}

TEST(StyleTarget, ShapesOfItsKindStayWhereTheyAre) {
  const Extent e{120, 100, 1};
  const auto g = planeGBuffer(view(e));
  for (const auto& [A, B, degrees, a] : std::vector<std::array<double, 4>>{{30, 15, 0, 0},
                                                                           {30, 15, 35, 0},
                                                                           {40, 8, 110, 0},
                                                                           {20, 20, 0, 0},
                                                                           {30, 15, 0, 1},
                                                                           {30, 12, 35, 1},
                                                                           {20, 20, 0, 1},
                                                                           {20, 20, 30, 1},
                                                                           {22, 21.9, 73, 1},
                                                                           {30, 15, 35, 0.5},
                                                                           {20, 20, 30, 0.6}}) {
    const TargetShape shape(A, B, a);
    const Frame2 f = turned(58.3, 50.6, degrees);
    const auto D = shadow(e, [&](double x, double y) { return shape.distance(f.u(x, y), f.v(x, y)) < 0; });
    const auto out = targeted(e, D, g, 1, float(a));
    EXPECT_EQ(wrongSides(out, e, shape, f, 0.75), 0u) << A << " " << B << " at " << degrees << ", angularity " << a;
    // T is the distance itself, within a pixel of where the raster puts the shape.
    for (size_t k = 0; k < e.elements(); k += 37)
      EXPECT_NEAR(out->floats("D")[k], shape.distance(f.u(double(k % 120), double(k / 120)), f.v(double(k % 120), double(k / 120))), 0.75);
  }
}

TEST(StyleTarget, OfWholePixelsIsExact) {  // a rectangle of 21 x 11 samples: its own moments
  const Extent e{60, 40, 1};
  const auto D = shadow(e, [](double x, double y) { return x >= 20 && x <= 40 && y >= 10 && y <= 20; });
  const auto all = piecesOf(D, planeGBuffer(view(e, 0.5f)), 1);
  ASSERT_EQ(all.pieces.size(), 1u);
  const ShadowPiece& p = all.pieces[0];
  EXPECT_NEAR(p.area, 21 * 11 * 0.25, 1e-4);
  EXPECT_NEAR(p.shape.A(), 10.5 * 0.5, 1e-4);
  EXPECT_NEAR(p.shape.B(), 5.5 * 0.5, 1e-4);
  EXPECT_NEAR(glm::length(p.centre - DVec3(15, 7.5, 0)), 0, 1e-5);
  EXPECT_NEAR(std::abs(p.u.x), 1, 1e-6);
}

bool blob(double x, double y) {
  const double a = std::atan2(y - 60, x - 62), r = std::hypot(x - 62, y - 60);
  return r < 26 + 9 * std::sin(3 * a + 0.5) + 5 * std::cos(2 * a) + 3 * std::sin(7 * a);
}

TEST(StyleTarget, OfABlobHasItsAreaAndPlace) {
  const Extent e{130, 120, 1};
  for (const bool oblique : {false, true}) {
    PlaneView v = view(e);
    if (oblique) v.dv = Vec3(0, 0.8f, 1.1f), v.du = Vec3(0.7f, 0.2f, 0), v.normal = glm::normalize(glm::cross(v.du, v.dv));
    const auto g = planeGBuffer(v);
    for (const float a : {0.0f, 0.4f, 1.0f}) {
      const TermPtr D = shadow(e, blob), out = targeted(e, D, g, 1, a);
      double area = 0, was = 0;
      DVec3 centre(0.0), before(0.0);
      for (size_t k = 0; k < e.elements(); ++k) {
        const DVec3 P(g->floats("P")[3 * k], g->floats("P")[3 * k + 1], g->floats("P")[3 * k + 2]);
        if (out->floats("D")[k] < 0) area += 1, centre += P;
        if (D->floats("D")[k] < 0) was += 1, before += P;
      }
      EXPECT_NEAR(area, was, 0.02 * was) << a;
      EXPECT_LT(glm::length(centre / area - before / was), 0.5) << a;
    }
  }
}

TEST(StyleTarget, PiecesKeepApart) {
  const Extent e{140, 80, 1};
  const auto g = planeGBuffer(view(e));
  const auto D = shadow(e, [](double x, double y) {
    return (std::abs(x - 35) < 20 && std::abs(y - 40) < 10 && !(x < 30 && y > 40)) || (std::hypot(x - 100, y - 40) < 20 && std::hypot(x - 100, y - 30) > 12);
  });
  const auto before = piecesOf(D, g);
  auto after = piecesOf(targeted(e, D, g, 1, 0), g);
  ASSERT_EQ(before.pieces.size(), 2u);
  ASSERT_EQ(after.pieces.size(), 2u);
  std::sort(after.pieces.begin(), after.pieces.end(), [&](const auto& a, const auto& b) {
    return (a.centre.x < b.centre.x) == (before.pieces[0].centre.x < before.pieces[1].centre.x) && a.centre.x != b.centre.x;
  });
  for (size_t k = 0; k < 2; ++k) {
    EXPECT_LT(glm::length(before.pieces[k].centre - after.pieces[k].centre), 0.5);
    EXPECT_NEAR(before.pieces[k].area, after.pieces[k].area, 0.02 * before.pieces[k].area);
  }
}

TEST(StyleTarget, IsTheLeastOverAllPiecesOneByOne) {  // what squares of samples leave out is never the nearest
  const Extent e{150, 110, 1};
  const auto g = planeGBuffer(view(e, 0.3f));
  auto N = g->writable<float>("N"), P = g->writable<float>("P");
  for (size_t k = 0; k < e.elements(); ++k)  // a wall stands on the right part; the lower part curves
    if (k % 150 > 100) {
      N[3 * k] = -1, N[3 * k + 2] = 0;
    } else if (k / 150 > 60) {
      const float a = 0.02f * float(k / 150 - 60);
      N[3 * k + 1] = std::sin(a), N[3 * k + 2] = std::cos(a), P[3 * k + 2] -= 0.5f * a * a;
    }
  const auto V = noiseTerm(e, "n", 5);
  const auto D = floatTerm(e, "D", [&](int x, int y, int) {
    const bool big = std::hypot(double(x) - 50, double(y) - 50) < 18;
    return big || (x > 75 && V->floats("n")[size_t(y * 150 + x)] < 0.03f) ? -0.5f : 0.5f;
  });
  const auto all = piecesOf(D, g);
  EXPECT_GT(all.pieces.size(), 150u);
  const auto out = targeted(e, D, g, 1, 0);
  for (size_t k = 0; k < e.elements(); ++k) {
    const Vec3 n(N[3 * k], N[3 * k + 1], N[3 * k + 2]);
    double T = HUGE_VAL;
    for (size_t p = 0; p < all.pieces.size(); ++p)
      if (all.label[k] == p || glm::dot(all.pieces[p].normal, n) >= std::cos(kPi / 4) - kRoundedCosine)
        T = std::min(T, distanceToTarget(all.pieces[p], DVec3(P[3 * k], P[3 * k + 1], P[3 * k + 2])));
    ASSERT_NEAR(double(out->floats("D")[k]), T, 1e-5) << k;
  }
}

TEST(StyleTarget, OfOtherSurfacesIsFarAway) {  // a step down by 5 beside the shadow: what lies under its ellipse is not in it
  const Extent e{80, 60, 1};
  const auto g = planeGBuffer(view(e));
  const auto P = g->writable<float>("P");
  const auto instance = g->writable<uint32_t>("instance");
  for (size_t k = 0; k < e.elements(); ++k)
    if (k % 80 >= 40) P[3 * k + 2] = -5, instance[k] = 1;
  const auto out = targeted(e, shadow(e, [](double x, double y) { return x >= 20 && x < 40 && std::abs(y - 30) < 20; }), g, 1, 0);
  for (int y = 0; y < 60; ++y)
    for (int x = 40; x < 80; ++x) EXPECT_GE(out->floats("D")[size_t(y * 80 + x)], 4.0f - 1e-4f);
  EXPECT_LT(out->floats("D")[30 * 80 + 39], 0);
}

TEST(StyleTarget, BetweenItIsTheMixtureAndAtZeroTheBits) {
  const Extent e{130, 120, 2};
  const auto g = planeGBuffer(view(e));
  const auto D = floatTerm(e, "D", [](int x, int y, int l) { return (blob(x, y) ? -1.0f : 1.0f) * (0.1f + 0.01f * float(x + l)); });
  const auto none = targeted(e, D, g, 0, 0.3f), half = targeted(e, D, g, 0.5f, 0.3f), all = targeted(e, D, g, 1, 0.3f), one = targeted(e, D, g, 1, 0.3f, 1);
  for (size_t k = 0; k < e.elements(); ++k) {
    ASSERT_EQ(std::bit_cast<uint32_t>(none->floats("D")[k]), std::bit_cast<uint32_t>(D->floats("D")[k]));
    ASSERT_NEAR(half->floats("D")[k], 0.5f * (D->floats("D")[k] + all->floats("D")[k]), 1e-4f);
    ASSERT_EQ(std::bit_cast<uint32_t>(one->floats("D")[k]), std::bit_cast<uint32_t>(all->floats("D")[k])) << "threads";
    ASSERT_NE(all->floats("D")[k], 0.0f);
  }
}

TEST(StyleTarget, SmallAndThinPiecesHaveShapes) {
  const Extent e{60, 40, 1};
  for (const float scale : {1e-5f, 1.0f, 1e5f}) {
    const auto g = planeGBuffer(view(e, scale));
    const auto D = shadow(e, [](double x, double y) {
      return (x == 5 && y == 5) || ((x == 10 || x == 11) && y == 5) || (y == 20 && x >= 5 && x < 55) || (x - y == 20 && y > 25);
    });
    for (const float a : {0.0f, 0.5f, 1.0f}) {
      const auto out = targeted(e, D, g, 1, a);
      for (const float d : out->floats("D")) ASSERT_TRUE(std::isfinite(d) && d != 0.0f);
      for (const size_t k : {size_t(5 * 60 + 5), size_t(5 * 60 + 10), size_t(20 * 60 + 30), size_t(30 * 60 + 50)})
        EXPECT_LT(out->floats("D")[k], 0) << k << " " << a;
    }
    const auto all = piecesOf(D, g, 1);
    ASSERT_EQ(all.pieces.size(), 4u);
    EXPECT_NEAR(all.pieces[2].shape.A() / double(scale), 25, 1e-3);
    EXPECT_NEAR(all.pieces[2].shape.B() / double(scale), 0.5, 1e-3);
  }
}

TEST(StyleTarget, WithoutAnAreaADirectionOrAContourDistancesStay) {
  const Extent e{20, 20, 1};
  const auto D = shadow(e, [](double x, double y) { return std::hypot(x - 9, y - 9) < 5; });
  PlaneView v = view(e);
  v.du = v.dv = Vec3(0.0f);  // all samples in one place
  for (size_t k = 0; k < e.elements(); ++k) ASSERT_EQ(plane(targeted(e, D, planeGBuffer(v), 1, 0))[k], D->floats("D")[k]);
  auto opposite = planeGBuffer(view(e));  // normals that cancel
  for (size_t k = 0; k < e.elements(); ++k) opposite->writable<float>("N")[3 * k + 2] = k % 2 ? 1.0f : -1.0f;
  for (const float d : plane(targeted(e, D, opposite, 1, 0, 2, kPi))) ASSERT_TRUE(std::isfinite(d));
  for (const float far : {kStyleFar, -kStyleFar}) {
    const auto none = floatTerm(e, "D", [&](int, int, int) { return far; });
    for (const float d : plane(targeted(e, none, planeGBuffer(view(e)), 0.5f, 0))) ASSERT_EQ(d, far);
  }
  auto empty = planeGBuffer(view(e));
  for (uint32_t& i : empty->writable<uint32_t>("instance")) i = ~0u;
  for (size_t k = 0; k < e.elements(); ++k) ASSERT_EQ(plane(targeted(e, D, empty, 1, 0))[k], D->floats("D")[k]);
}

}  // namespace stylised_target_test
}  // namespace gobo

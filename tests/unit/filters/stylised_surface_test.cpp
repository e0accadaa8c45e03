// SPDX-License-Identifier: Apache-2.0
// Distances along surfaces: links between view samples, and the march over them against closed forms.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdio>
#include <ctime>

#include "filters/stylised/averaged_distance.h"
#include "filters/stylised/surface_distance.h"
#include "filters/stylised/surface_march.h"
#include "filters/stylised/transfer.h"
#include "filters/stylised/unfolded_links.h"
#include "support/stopping.h"
#include "unit/filters/synthetic.h"

namespace gobo {
namespace stylised_surface_test {

using namespace test;

constexpr float kCosine = 0.70710678f;

struct Seen {
  double t = HUGE_VAL;
  DVec3 normal{0.0};
  uint32_t instance = ~0u;
};
/// A camera, and what its rays meet: the nearest of planes, spheres, cylinders that a test adds.
struct View {
  int width = 160, height = 120;
  DVec3 eye{0, 2, 4};
  double tilt = 0.5, roll = 0, window = 1.0;  // radians below the horizon; height of the window at distance 1
  std::vector<std::function<Seen(const DVec3& o, const DVec3& d)>> things;

  /// All of a plane through `at` where `inside` holds.
  void plane(const DVec3& at, const DVec3& n, uint32_t instance, const std::function<bool(const DVec3&)>& inside = {}) {
    things.push_back([=](const DVec3& o, const DVec3& d) {
      Seen s;
      const double t = glm::dot(at - o, n) / glm::dot(d, n);
      if (t > 1e-9 && std::isfinite(t) && (!inside || inside(o + t * d))) s = {t, glm::dot(n, d) < 0 ? n : -n, instance};
      return s;
    });
  }
  void sphere(const DVec3& c, double R, uint32_t instance) {
    things.push_back([=](const DVec3& o, const DVec3& d) {
      Seen s;
      const DVec3 r = o - c;
      const double b = glm::dot(r, d), under = b * b - glm::dot(r, r) + R * R;
      if (under > 0 && -b - std::sqrt(under) > 0) s = {-b - std::sqrt(under), (r + (-b - std::sqrt(under)) * d) / R, instance};
      return s;
    });
  }
  TermPtr picture() const {
    auto g = planeGBuffer({width, height, 1});
    auto P = g->writable<float>("P"), N = g->writable<float>("N"), Ng = g->writable<float>("Ng"), footprint = g->writable<float>("footprint");
    auto instance = g->writable<uint32_t>("instance");
    const DVec3 forward(0, -std::sin(tilt), -std::cos(tilt)), across(1, 0, 0), above = glm::cross(across, forward);
    const DVec3 right = std::cos(roll) * across + std::sin(roll) * above, up = std::cos(roll) * above - std::sin(roll) * across;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const size_t e = size_t(y) * size_t(width) + size_t(x);
        const DVec3 d = glm::normalize(forward + window * ((x + 0.5 - 0.5 * width) / height * right + (0.5 - (y + 0.5) / height) * up));
        Seen nearest;
        for (const auto& thing : things)
          if (const Seen s = thing(eye, d); s.t < nearest.t) nearest = s;
        instance[e] = nearest.instance;
        const DVec3 p = nearest.instance == ~0u ? DVec3(0.0) : eye + nearest.t * d;
        for (int c = 0; c < 3; ++c) P[3 * e + size_t(c)] = float(p[c]), N[3 * e + size_t(c)] = Ng[3 * e + size_t(c)] = float(nearest.normal[c]);
        footprint[e] = nearest.instance == ~0u ? 0.0f : float(nearest.t * window / height);
      }
    return g;
  }
};
DVec3 at(const Term& g, size_t e) { return DVec3(g.floats("P")[3 * e], g.floats("P")[3 * e + 1], g.floats("P")[3 * e + 2]); }
bool hit(const Term& g, size_t e) { return g.plane<uint32_t>("instance")[e] != ~0u; }

/// Visibility that is 1/2 where `signedDistance` is 0 and linear about it, so that the contour lies where it should between samples too.
TermPtr visibility(const Term& g, const std::function<double(const DVec3&)>& signedDistance, double width = 40.0) {
  return floatTerm(g.extent(), "V", [&](int x, int y, int) {
    const size_t e = size_t(y) * size_t(g.extent().width) + size_t(x);
    return hit(g, e) ? float(std::clamp(0.5 + signedDistance(at(g, e)) / width, 0.0, 1.0)) : 1.0f;
  });
}
StyleDistanceSettings settings(const Extent& e, float angle = kPi / 4) {
  StyleDistanceSettings s;
  s.extent = e;
  s.angle = angle;
  return s;
}
TermPtr along(const TermPtr& V, const TermPtr& g, int threads = 2, float angle = kPi / 4) {
  return runFilter(makeSurfaceDistanceNode(settings(g->extent(), angle)), {V, g}, threads);
}
/// Largest error of D, of the distance that it should have and `steps` pixels' widths, over samples whose distance is finite in `expected`.
struct Errors {
  double relative = 0, share = 0;  // of the distance, where that is 8 widths or more; of a width, where it is less
  size_t count = 0;
};
Errors errors(const Term& D, const Term& g, const std::function<double(const DVec3&)>& expected) {
  Errors out;
  for (size_t e = 0; e < g.extent().elements(); ++e) {
    if (!hit(g, e)) continue;
    const double should = expected(at(g, e)), width = double(g.floats("footprint")[e]);
    if (!std::isfinite(should)) continue;
    const double d = double(D.floats("D")[e]);
    EXPECT_EQ(d > 0, should > 0) << e;
    const double error = std::abs(d - should);
    if (std::getenv("STYLE_WORST") && error > std::max(out.relative * std::abs(should), width))
      std::printf("pixel %zu %zu: %g, should be %g, width %g\n", e % size_t(g.extent().width), e / size_t(g.extent().width), d, should, width);
    if (std::abs(should) >= 8 * width) out.relative = std::max(out.relative, error / std::abs(should));
    else out.share = std::max(out.share, error / width);
    ++out.count;
  }
  if (std::getenv("STYLE_PRINT"))
    std::printf("%s: %.5f of the distance, near the contour %.4f of a width, %zu samples\n", ::testing::UnitTest::GetInstance()->current_test_info()->name(),
                out.relative, out.share, out.count);
  return out;
}

// ---- Links ------------------------------------------------------------------------------------------------------------------
TEST(StyleSurfaceLinks, APlaneCornersAndEdgesHoldTogetherAndStepsDoNot) {
  struct Case {
    const char* what;
    Vec3 step, n, m;  // from the first sample to the second, and their normals
    bool linked;
  };
  const float s = std::sqrt(0.5f);
  for (const Case& c : std::vector<Case>{
           {"a plane seen head on", {1, 0, 0}, {0, 0, 1}, {0, 0, 1}, true},
           {"a plane seen at its most grazing", {0, 0, -400}, {0, 1, 0}, {0, 1, 0}, true},
           {"a floor and the wall behind it", {0, 0.5f, -6}, {0, 1, 0}, {0, 0, 1}, true},
           {"the top of a box and its front", {0, -0.5f, 4}, {0, 1, 0}, {0, 0, 1}, true},
           {"a bend", {1, 0, -0.4f}, {0, 0, 1}, {s, 0, s}, true},
           {"a card in front of a wall", {1, 0, -30}, {0, 0, 1}, {0, 0, 1}, false},
           {"a card in front of a wall, less than a width", {1, 0, -0.7f}, {0, 0, 1}, {0, 0, 1}, true},
           {"a box's front and the floor far behind it", {0, -3, -9}, {0, 0, 1}, {0, 1, 0}, false},
           {"a corner too far away", {0, 0.5f, -17}, {0, 1, 0}, {0, 0, 1}, false},
           {"what turns its side to the eye, and what is far behind", {1, 0, -40}, {1, 0, 0}, {0, 0, 1}, false},
       }) {
    PlaneView v;
    v.width = 2, v.height = 1;
    auto g = planeGBuffer(v);
    for (size_t e = 0; e < 2; ++e) {
      const Vec3 p = e == 0 ? Vec3(0.0f) : c.step, n = e == 0 ? c.n : c.m;
      for (size_t k = 0; k < 3; ++k)
        g->writable<float>("P")[3 * e + k] = p[int(k)], g->writable<float>("N")[3 * e + k] = g->writable<float>("Ng")[3 * e + k] = n[int(k)];
      g->writable<float>("footprint")[e] = 1;
    }
    const ContourInput in = surfaceInput(*g, 0);
    EXPECT_EQ(onOneStretch(in, 0, 1, kCosine), c.linked) << c.what;
    EXPECT_EQ(onOneStretch(in, 1, 0, kCosine), c.linked) << c.what;
    g->writable<uint32_t>("instance")[1] = 1;
    EXPECT_EQ(onOneStretch(surfaceInput(*g, 0), 0, 1, kCosine), c.linked) << c.what << ", of two instances";
    g->writable<uint32_t>("instance")[1] = ~0u;
    EXPECT_FALSE(onOneStretch(surfaceInput(*g, 0), 0, 1, kCosine));
    EXPECT_FALSE(onOneStretch(surfaceInput(*g, 0), 1, 0, kCosine));
  }
}

TEST(StyleSurfaceLinks, AroundACornerLengthIsThatOfTheUnfoldedPlanes) {
  PlaneView v;
  v.width = 2, v.height = 1;
  auto g = planeGBuffer(v);
  const auto put = [&](size_t e, const Vec3& p, const Vec3& n) {
    for (size_t k = 0; k < 3; ++k)
      g->writable<float>("P")[3 * e + k] = p[int(k)], g->writable<float>("N")[3 * e + k] = g->writable<float>("Ng")[3 * e + k] = n[int(k)];
  };
  put(0, Vec3(0, 0, 3), Vec3(0, 1, 0));
  put(1, Vec3(2, 1, 0), Vec3(0, 0, 1));
  EXPECT_NEAR(surfaceStep(surfaceInput(*g, 0), 0, 1), std::sqrt(16.0 + 4.0), 1e-12);
  EXPECT_NEAR(surfaceStep(surfaceInput(*g, 0), 1, 0), std::sqrt(16.0 + 4.0), 1e-12);
  put(1, Vec3(2, 0, 0), Vec3(0, 1, 0));
  EXPECT_NEAR(surfaceStep(surfaceInput(*g, 0), 0, 1), std::sqrt(13.0), 1e-12);
  // Two planes at 60 degrees, a and b from their line.
  const double c = 0.5, s = std::sqrt(0.75);
  put(0, Vec3(2, 0, 0), Vec3(0, 1, 0));
  put(1, Vec3(float(3 * c), float(3 * s), 1), Vec3(float(s), float(-c), 0));
  EXPECT_NEAR(surfaceStep(surfaceInput(*g, 0), 0, 1), std::sqrt(25.0 + 1.0), 1e-6);
}

TEST(StyleSurfaceLinks, ADiagonalNeedsASideThatGoesRound) {  // a wire in front of a plane: one sample wide, aslant
  const Extent e{12, 12, 1};
  auto g = planeGBuffer({12, 12, 1});
  for (int k = 0; k < 12; ++k) {
    const size_t w = size_t(k * 12 + k);
    g->writable<uint32_t>("instance")[w] = 1;
    g->writable<float>("P")[3 * w + 2] = 5;
  }
  const TaskArena arena(2);
  const auto links = *surfaceLinks(surfaceInput(*g, 0), kCosine, arena, {});
  for (int y = 0; y < 12; ++y)
    for (int x = 0; x < 12; ++x)
      for (size_t k = 0; k < 8; ++k) {
        const int u = x + kAround[k].x, v = y + kAround[k].y;
        const bool inside = u >= 0 && v >= 0 && u < 12 && v < 12;
        const auto side = [](int a, int b) { return a < b ? -1 : a > b ? 1 : 0; };
        EXPECT_EQ(links[size_t(y * 12 + x)] >> k & 1, inside && side(x, y) == side(u, v) && side(x, y) != 0) << x << " " << y << " " << k;
      }
}

// ---- The march --------------------------------------------------------------------------------------------------------------
TEST(StyleSurface, AStraightEdgeOnAPlaneInPerspectiveIsAsFarAsItIs) {
  for (const double tilt : {1.2, 0.5, 0.12})
    for (const double roll : {0.0, 0.3, 0.9})
      for (const double turn : {0.0, 0.4, 1.2}) {
        View v;
        v.tilt = tilt, v.roll = roll;
        v.plane(DVec3(0.0), DVec3(0, 1, 0), 3, [](const DVec3& p) { return std::abs(p.x) < 8 && p.z > -20; });
        const auto g = v.picture();
        const double middle = 4 - 2 / std::tan(std::max(tilt, 0.3) + 0.1);  // in view
        const auto edge = [&](const DVec3& p) { return std::cos(turn) * (p.x - 0.3) + std::sin(turn) * (p.z - middle); };
        const auto V = visibility(*g, edge);
        const auto D = along(V, g);
        // Where the foot of the perpendicular is seen, some pixels from the floor's border.
        const Errors e = errors(*D, *g, [&](const DVec3& p) {
          const DVec3 foot = p - edge(p) * DVec3(std::cos(turn), 0, std::sin(turn));
          const DVec3 forward(0, -std::sin(tilt), -std::cos(tilt)), across(1, 0, 0), above = glm::cross(across, forward);
          const DVec3 to = foot - v.eye;
          const double z = glm::dot(to, forward), a = glm::dot(to, across) / z, b = glm::dot(to, above) / z;
          const double x = std::cos(roll) * a + std::sin(roll) * b, y = std::cos(roll) * b - std::sin(roll) * a;
          return z > 0 && std::abs(x) < 0.62 && std::abs(y) < 0.46 && std::abs(foot.x) < 7 && foot.z > -12 && p.z > -12 && std::abs(p.x) < 7 ? edge(p)
                                                                                                                                             : HUGE_VAL;
        });
        EXPECT_GT(e.count, 1000u) << tilt << " " << roll << " " << turn;
        EXPECT_LT(e.relative, 0.001) << tilt << " " << roll << " " << turn;
        EXPECT_LT(e.share, 0.3) << tilt << " " << roll << " " << turn;  // beside the picture's border
      }
}

TEST(StyleSurface, ADiscOnAPlaneInPerspectiveIsItsRadiusAway) {
  for (const double roll : {0.0, 0.6}) {
    View v;
    v.tilt = 0.6, v.roll = roll;
    v.plane(DVec3(0.0), DVec3(0, 1, 0), 3);
    const auto g = v.picture();
    const auto edge = [](const DVec3& p) { return std::hypot(p.x - 0.2, p.z - 1.1) - 0.6; };
    const auto V = visibility(*g, edge);
    const Errors e = errors(*along(V, g), *g, [&](const DVec3& p) { return std::abs(p.x) < 3 && p.z > -4 ? edge(p) : HUGE_VAL; });
    EXPECT_GT(e.count, 8000u);
    EXPECT_LT(e.relative, 0.015);  // the contour's own: chords of the circle
    EXPECT_LT(e.share, 0.1);
  }
}

TEST(StyleSurface, UpAWallIsTheSumOfBothWays) {  // and over the edge of a box
  const auto room = [](bool inner) {
    View v;
    v.eye = DVec3(0.3, 2.2, 5);
    v.tilt = 0.4;
    if (inner) {
      v.plane(DVec3(0.0), DVec3(0, 1, 0), 0, [](const DVec3& p) { return p.z > 0; });
      v.plane(DVec3(0.0), DVec3(0, 0, 1), 1, [](const DVec3& p) { return p.y > 0; });
    } else {
      v.plane(DVec3(0.0), DVec3(0, 1, 0), 0, [](const DVec3& p) { return p.z < 0; });
      v.plane(DVec3(0.0), DVec3(0, 0, 1), 1, [](const DVec3& p) { return p.y < 0; });
    }
    return v.picture();
  };
  for (const bool inner : {true, false}) {
    const auto g = room(inner);
    const double from = inner ? 1.5 : -1.0;
    const auto flat = [&](const DVec3& p) { return inner ? from - (std::abs(p.y) < 1e-3 ? p.z : 0.0) : (std::abs(p.y) < 1e-3 ? p.z : 0.0) - from; };
    const auto unfolded = [&](const DVec3& p) { return flat(p) + (std::abs(p.y) > 1e-3 ? std::abs(p.y) : 0.0); };
    const auto V = visibility(*g, unfolded);
    const Errors e = errors(*along(V, g), *g, [&](const DVec3& p) { return std::abs(p.x - 0.3) < 1.2 ? unfolded(p) : HUGE_VAL; });
    EXPECT_GT(e.count, 4000u);
    EXPECT_LT(e.relative, 0.002);
    EXPECT_LT(e.share, 0.05);
    // In the world it is the chord.
    StyleDistanceSettings s = settings(g->extent(), 3.1415926f);
    s.power = 64;
    const auto world = runFilter(makeStyleDistanceNode(s), {V, g});
    double most = 0;
    for (size_t k = 0; k < g->extent().elements(); ++k)
      if (hit(*g, k) && std::abs(at(*g, k).y) > 0.8 && std::abs(at(*g, k).x - 0.3) < 1)
        most = std::max(most, 1 - double(world->floats("D")[k]) / unfolded(at(*g, k)));
    EXPECT_GT(most, 0.15);
  }
}

/// A strip of something in front of a plane: columns 60 to 65, from the top down to row 69.
TermPtr stripped(float height = 6) {
  const Extent e{128, 96, 1};
  PlaneView v;
  v.width = e.width, v.height = e.height;
  auto g = planeGBuffer(v);
  for (int y = 0; y < 70; ++y)
    for (int x = 60; x < 66; ++x) {
      g->writable<uint32_t>("instance")[size_t(y * 128 + x)] = height > 0 ? 1u : ~0u;
      g->writable<float>("P")[3 * size_t(y * 128 + x) + 2] = height;
    }
  return g;
}

TEST(StyleSurface, AroundAGapAndNotAcross) {
  for (const float height : {6.0f, 0.0f}) {  // something in front; a hole
    const auto g = stripped(height);
    const auto V = floatTerm(g->extent(), "V", [](int x, int, int) { return x < 20 ? 0.0f : 1.0f; });  // the edge is at 1.95
    const auto D = along(V, g);
    double most = 0;
    for (int y = 0; y < 96; ++y)
      for (int x = 20; x < 128; ++x) {
        const bool strip = x >= 60 && x < 66 && y < 70;
        const float d = D->floats("D")[size_t(y * 128 + x)];
        if (strip) {
          EXPECT_EQ(d, kStyleFar) << "nothing leads to it";
          continue;
        }
        // Around the strip's lower end: samples are linked from row 70 on.
        double expected = 0.1 * x - 1.95;
        if (x >= 66 && y < 70) {  // by sample (65, 70), and by (66, 69) where that is in the way
          const bool clear = (y - 70.0) / (x - 65.0) >= -1;
          expected = 0.1 * ((clear ? std::hypot(x - 65, y - 70) : std::hypot(x - 66, y - 69) + std::sqrt(2.0)) + 65) - 1.95;
        }
        most = std::max(most, std::abs(double(d) - expected) / expected);
      }
    if (std::getenv("STYLE_PRINT")) std::printf("around a gap: %.4f\n", most);
    EXPECT_LT(most, 0.015);
  }
}

TEST(StyleSurface, WhatOnlyOverlapsInThePictureIsNotConnected) {
  const Extent e{64, 48, 1};
  for (const bool dark : {false, true}) {
    PlaneView v;
    v.width = e.width, v.height = e.height;
    auto g = planeGBuffer(v);
    for (int y = 10; y < 30; ++y)
      for (int x = 30; x < 50; ++x) g->writable<uint32_t>("instance")[size_t(y * 64 + x)] = 7, g->writable<float>("P")[3 * size_t(y * 64 + x) + 2] = 3;
    const auto V = floatTerm(e, "V", [&](int x, int y, int) {
      const bool card = x >= 30 && x < 50 && y >= 10 && y < 30;
      return card ? (dark ? 0.0f : 1.0f) : (x < 12 ? 0.0f : 1.0f);
    });
    const auto D = along(V, g);
    for (int y = 0; y < 48; ++y)
      for (int x = 0; x < 64; ++x) {
        const float d = D->floats("D")[size_t(y * 64 + x)];
        if (x >= 30 && x < 50 && y >= 10 && y < 30) EXPECT_EQ(d, dark ? -kStyleFar : kStyleFar);
        else EXPECT_LT(std::abs(d), 10.0f);
      }
  }
}

TEST(StyleSurface, OverASphereItIsTheArc) {
  View v;
  v.eye = DVec3(0, 0, 6), v.tilt = 0, v.window = 0.5;
  v.sphere(DVec3(0.0), 1.0, 0);
  const auto g = v.picture();
  const DVec3 pole = glm::normalize(DVec3(0.2, 0.5, 1));
  const auto arc = [&](const DVec3& p) { return std::acos(std::clamp(glm::dot(glm::normalize(p), pole), -1.0, 1.0)) - 0.35; };
  const auto V = visibility(*g, arc);
  const Errors e = errors(*along(V, g), *g, [&](const DVec3& p) { return p.z > 0.35 ? arc(p) : HUGE_VAL; });
  EXPECT_GT(e.count, 3000u);
  EXPECT_LT(e.relative, 0.018);
  EXPECT_LT(e.share, 0.1);
}

TEST(StyleSurface, ANeutralStyleIsTheShadowToTheBit) {
  View v;
  v.plane(DVec3(0.0), DVec3(0, 1, 0), 0);
  v.sphere(DVec3(0, 0.6, 0), 0.6, 1);
  const auto g = v.picture();
  const auto V = floatTerm(g->extent(), "V", [](int x, int y, int) { return (x / 13 + y / 9) % 3 == 0 ? 0.0f : 1.0f; });
  const auto S = runFilter(makeStyleTransferNode({}), {along(V, g)});
  for (size_t e = 0; e < g->extent().elements(); ++e)
    if (hit(*g, e)) { ASSERT_EQ(std::bit_cast<uint32_t>(S->floats("V")[e]), std::bit_cast<uint32_t>(V->floats("V")[e])) << e; }
}

TEST(StyleSurface, ScalesWithTheScene) {
  View v;
  v.tilt = 0.3;
  v.plane(DVec3(0.0), DVec3(0, 1, 0), 0, [](const DVec3& p) { return p.z > -6; });
  v.plane(DVec3(0, 0, -6), DVec3(0, 0, 1), 1);
  v.sphere(DVec3(0, 0.5, 0.5), 0.5, 2);
  const auto g = v.picture();
  const auto edge = [](const DVec3& p) { return std::hypot(p.x - 0.7, p.z - 0.5) - 0.8; };
  const auto V = visibility(*g, edge);
  const auto D = along(V, g);
  for (const float scale : {1e-4f, 1e6f}) {
    auto scaled = std::make_shared<Term>("gbuffer", Domain::ViewSample, g->extent());
    for (const Plane& p : g->planes()) scaled->addRaw(p.name, p.format, p.channels).bytes = p.bytes;
    for (float& x : scaled->writable<float>("P")) x *= scale;
    for (float& x : scaled->writable<float>("footprint")) x *= scale;
    const auto E = along(V, scaled);
    for (size_t e = 0; e < g->extent().elements(); ++e) {
      const double d = double(D->floats("D")[e]), f = double(E->floats("D")[e]);
      if (std::abs(d) < 1e29) {
        ASSERT_NEAR(f / double(scale), d, 0.005 * std::abs(d) + 0.01 * double(g->floats("footprint")[e])) << e << " " << scale;
      } else ASSERT_EQ(d, f);
    }
  }
}

TEST(StyleSurface, SmallPicturesHolesAndNoContour) {
  for (const auto& [w, h] : std::vector<std::pair<int, int>>{{1, 1}, {1, 9}, {9, 1}, {2, 2}}) {
    PlaneView v;
    v.width = w, v.height = h;
    const auto g = planeGBuffer(v);
    for (const float value : {0.0f, 1.0f}) {
      const auto D = along(floatTerm({w, h, 1}, "V", [&](int, int, int) { return value; }), g);
      for (const float d : D->floats("D")) EXPECT_EQ(d, value > 0 ? kStyleFar : -kStyleFar);
    }
  }
  PlaneView v;
  v.width = 40, v.height = 30;
  auto g = planeGBuffer(v);
  const auto V = floatTerm({40, 30, 1}, "V", [](int x, int y, int) { return x > y ? 0.0f : 1.0f; });
  for (size_t e = 0; e < 1200; ++e)
    if (hash64(5, e) % 3 == 0) g->writable<uint32_t>("instance")[e] = ~0u;
  size_t near = 0;
  const auto holed = along(V, g);
  for (size_t e = 0; e < 1200; ++e) {
    const float d = holed->floats("D")[e];
    ASSERT_TRUE(std::isfinite(d) && d != 0);
    if (!hit(*g, e)) {
      EXPECT_EQ(d, kStyleFar);
      continue;
    }
    near += std::abs(d) < 5;
    EXPECT_EQ(d > 0, V->floats("V")[e] > 0);
  }
  EXPECT_GT(near, 300u);
  for (uint32_t& i : g->writable<uint32_t>("instance")) i = ~0u;
  const auto nothing = along(V, g);
  for (const float d : nothing->floats("D")) EXPECT_EQ(d, kStyleFar);
}

TEST(StyleSurface, BitsDoNotDependOnThreadsAndLayersAreApart) {
  View v;
  v.tilt = 0.4;
  v.plane(DVec3(0.0), DVec3(0, 1, 0), 0, [](const DVec3& p) { return p.z > -6; });
  v.plane(DVec3(0, 0, -6), DVec3(0, 0, 1), 1);
  const auto one = v.picture();
  const size_t n = one->extent().elements();
  const Extent e{v.width, v.height, 6};
  auto g = std::make_shared<Term>("gbuffer", Domain::ViewSample, e);
  for (const Plane& p : one->planes()) {
    Plane& q = g->addRaw(p.name, p.format, p.channels);
    for (size_t l = 0; l < 6; ++l) std::copy(p.bytes.begin(), p.bytes.end(), q.bytes.begin() + l * p.bytes.size());
  }
  const auto V = floatTerm(e, "V", [](int x, int y, int l) { return (x / 17 + y / (7 + l)) % 2 ? 0.0f : 1.0f; });
  const auto D = along(V, g, 1);
  for (const int threads : {2, 5}) EXPECT_EQ(along(V, g, threads)->content(), D->content());
  for (size_t l = 0; l < 6; ++l) {
    const auto alone = along(floatTerm(one->extent(), "V", [&](int x, int y, int) { return (x / 17 + y / (7 + int(l))) % 2 ? 0.0f : 1.0f; }), one);
    for (size_t k = 0; k < n; ++k) ASSERT_EQ(alone->floats("D")[k], D->floats("D")[l * n + k]);
  }
}

TEST(StyleSurface, StopsWhenItIsTold) {
  PlaneView v;
  v.width = 300, v.height = 200;
  const auto g = planeGBuffer(v);
  const auto V = floatTerm({300, 200, 1}, "V", [](int x, int, int) { return x > 150 ? 0.0f : 1.0f; });
  const ContourInput in = contourInput(*V, *g, 0);
  const TaskArena arena(1);
  std::vector<uint32_t> squares;
  const auto contour = *extractContour(in, kCosine, arena, {}, &squares);
  ASSERT_EQ(squares.size(), contour.size());
  const auto links = *surfaceLinks(in, kCosine, arena, {});
  EXPECT_EQ(marchSurface(in, links, contour, squares, kCosine, tests::stopAt(5)).status().code(), Code::Cancelled);
  EXPECT_EQ(surfaceLinks(in, kCosine, arena, tests::stopAt(5)).status().code(), Code::Cancelled);
  EXPECT_GE(tests::pollsOf([&](const StopToken& token) { EXPECT_TRUE(marchSurface(in, links, contour, squares, kCosine, token).ok()); }), 10);
}

/// STYLE_PRINT-like: a floor and a wall at 1920 x 1080, processor time of the node.
TEST(StyleSurface, DISABLED_Time) {
  View v;
  v.width = 1920, v.height = 1080, v.tilt = 0.3;
  v.plane(DVec3(0.0), DVec3(0, 1, 0), 0, [](const DVec3& p) { return p.z > -6; });
  v.plane(DVec3(0, 0, -6), DVec3(0, 0, 1), 1);
  v.sphere(DVec3(0, 0.5, 0.5), 0.5, 2);
  const auto g = v.picture();
  const auto V = visibility(*g, [](const DVec3& p) { return std::sin(2 * p.x) * std::cos(2 * p.z) - 0.3; });
  const std::clock_t begin = std::clock();
  along(V, g, 1);
  std::printf("1920 x 1080: %.0f ms\n", 1e3 * double(std::clock() - begin) / CLOCKS_PER_SEC);
}

}  // namespace stylised_surface_test
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Shadows drawn out along their surface, away from the light: closed forms on planes and a cylinder, walks past obstacles, guards.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>

#include "filters/stylised/distance_field.h"
#include "filters/stylised/elongation.h"
#include "unit/filters/synthetic.h"

namespace gobo {
namespace stylised_elongation_test {

using namespace test;

constexpr float kPixel = 0.1f;
constexpr double kRadius = 1.5;

/// A plane z = 0 from above: sample (x, y) at (0.1 x, -0.1 y, 0).
struct Table {
  Extent e;
  std::shared_ptr<Term> g;
  StyleElongationSettings s;
  explicit Table(int width = 128, int height = 128, float scale = 1.0f) : e{width, height, 1} {
    PlaneView v;
    v.width = width, v.height = height;
    v.du = Vec3(kPixel * scale, 0, 0), v.dv = Vec3(0, -kPixel * scale, 0);
    g = planeGBuffer(v);
    s.extent = e;
    s.camera.perspective = false;
    s.camera.yheight = kPixel * scale * float(height);
    s.camera.toWorld[3] = Vec4(0.5f * float(width - 1) * kPixel * scale, -0.5f * float(height - 1) * kPixel * scale, 5 * scale, 1);
    s.length = 3 * scale;
  }
  DVec3 at(size_t k) const { return DVec3(g->floats("P")[3 * k], g->floats("P")[3 * k + 1], g->floats("P")[3 * k + 2]); }
  std::shared_ptr<Term> distances(const std::function<double(const DVec3&)>& f) const {
    auto D = floatTerm(e, "D", [](int, int, int) { return 0.0f; });
    for (size_t k = 0; k < e.elements(); ++k) D->writable<float>("D")[k] = f(at(k)) == 0.0 ? kLeastStyleDistance : float(f(at(k)));  // a distance is never 0
    return D;
  }
  std::shared_ptr<Term> disc(const DVec3& c) const {
    return distances([=](const DVec3& P) { return glm::length(P - c) - kRadius; });
  }
  std::vector<float> drawn(const TermPtr& D, int threads = 2) const {
    const TermPtr made = runFilter(makeStyleElongationNode(s), {D, g}, threads);
    const auto out = made->floats("D");
    return {out.begin(), out.end()};
  }
};

StyleLight sun(float degrees, float slant = 1.0f) {
  const float a = degrees * kPi / 180;
  return {glm::normalize(Vec3(std::cos(a) * slant, std::sin(a) * slant, -1)), true};
}
double toSegment(const DVec3& x, const DVec3& a, const DVec3& b) {
  const double t = std::clamp(glm::dot(x - a, b - a) / glm::dot(b - a, b - a), 0.0, 1.0);
  return glm::length(x - a - t * (b - a));
}
double areaBelowZero(const std::vector<float>& D) {
  double n = 0;
  for (const float d : D) n += d < 0 ? double(kPixel * kPixel) : 0;
  return n;
}

TEST(StyleElongation, ADiscBecomesAStadiumAwayFromTheLight) {
  for (const float degrees : {0.0f, 90.0f, 180.0f, 37.0f, 251.0f}) {
    Table t;
    t.s.light = sun(degrees);
    const double a = double(degrees) * M_PI / 180;
    const DVec3 way(std::cos(a), std::sin(a), 0), c = DVec3(6.4, -6.4, 0) - 1.5 * way;
    const auto D = t.drawn(t.disc(c));
    for (size_t k = 0; k < D.size(); ++k) {
      const DVec3 end = t.at(k) - 3.0 * way;
      if (end.x < 0 || end.y > 0 || end.x > 12.7 || end.y < -12.7) continue;  // it leaves the picture
      const double exact = toSegment(t.at(k), c, c + 3.0 * way) - kRadius;
      ASSERT_NEAR(double(D[k]), exact, 0.75 * double(kPixel)) << degrees << " at " << k;  // half a diagonal: the cone's tip between four samples
      if (exact > -1.0) { ASSERT_NEAR(double(D[k]), exact, 0.05 * double(kPixel)) << degrees << " at " << k; }
    }
    EXPECT_NEAR(areaBelowZero(D), M_PI * kRadius * kRadius + 2 * kRadius * 3.0, 0.01 * 16.07) << degrees;
  }
}

TEST(StyleElongation, OfTheMethodsDistanceHasTheStadiumsArea) {
  Table t;
  t.s.light = sun(20);
  const auto V = floatTerm(t.e, "V", [&](int x, int y, int) { return std::hypot(0.1 * x - 5.0, -0.1 * y + 6.4) < kRadius ? 0.0f : 1.0f; });
  StyleDistanceSettings d;
  d.extent = t.e;
  EXPECT_NEAR(areaBelowZero(t.drawn(runFilter(makeStyleDistanceNode(d), {V, t.g}))), M_PI * kRadius * kRadius + 2 * kRadius * 3.0, 0.015 * 16.07);
}

TEST(StyleElongation, TurnsWithTheLight) {  // by 90 degrees about the middle: sample (x, y) goes to (y, 127 - x)
  Table t;
  const auto blob = [&](bool turned) {
    return floatTerm(t.e, "D", [=](int x, int y, int) {
      const float u = float(turned ? 127 - y : x), v = float(turned ? x : y);
      return 0.05f * (std::hypot(u - 50, 1.7f * (v - 70)) - 12 - 4 * std::sin(0.3f * u));
    });
  };
  t.s.light = sun(30);
  const auto one = t.drawn(blob(false));
  t.s.light = sun(120);
  const auto turned = t.drawn(blob(true));
  double most = 0;
  for (int y = 0; y < 128; ++y)
    for (int x = 0; x < 128; ++x) most = std::max(most, std::abs(double(one[size_t(y * 128 + x)]) - double(turned[size_t((127 - x) * 128 + y)])));
  EXPECT_LT(most, 1e-4);
}

TEST(StyleElongation, WithoutLengthItIsTheDistanceToTheBit) {
  Table t;
  t.s.light = sun(30);
  t.s.length = 0;
  const auto D = t.disc(DVec3(5, -5, 0));
  const auto out = t.drawn(D);
  for (size_t k = 0; k < out.size(); ++k) ASSERT_EQ(std::bit_cast<uint32_t>(out[k]), std::bit_cast<uint32_t>(D->floats("D")[k]));
}

TEST(StyleElongation, UnderALampStreaksAreRadial) {
  Table t;
  const DVec3 foot(6.35, -6.35, 0), c(8.5, -6.0, 0);
  t.s.light = {Vec3(6.35f, -6.35f, 3.0f), false};
  const auto D = t.drawn(t.disc(c));
  for (size_t k = 0; k < D.size(); ++k) {
    const DVec3 x = t.at(k), away = x - foot;
    const double r = glm::length(away);
    const double exact = r < 1e-2 ? glm::length(x - c) - kRadius : toSegment(c, x, x - 3.0 * away / r) - kRadius;
    if (exact > -1.0 && r > 0.02) { ASSERT_NEAR(double(D[k]), exact, 0.05 * double(kPixel)) << k; }
    ASSERT_TRUE(std::isfinite(D[k]));
  }
}

TEST(StyleElongation, UnderALightStraightAboveNothingIsDrawnOut) {
  Table t;
  const auto D = t.disc(DVec3(6.35, -6.35, 0));
  t.s.light = {Vec3(0, 0, -1), true};
  EXPECT_EQ(t.drawn(D), (std::vector<float>{D->floats("D").begin(), D->floats("D").end()}));
  t.s.light = {glm::normalize(Vec3(2e-4f, 0, -1)), true};  // its direction along the surface is rounding
  EXPECT_EQ(t.drawn(D), (std::vector<float>{D->floats("D").begin(), D->floats("D").end()}));
  t.s.light = {Vec3(float(0.1 * 64), float(-0.1 * 64), 0), false};  // the lamp lies on the surface, at a sample
  for (const float d : t.drawn(D)) ASSERT_TRUE(std::isfinite(d));
}

/// A floor y = 0 by a camera's own rays.
struct Ground {
  Extent e{160, 120, 1};
  Camera camera;
  std::shared_ptr<Term> g;
  explicit Ground(bool panorama = false) {
    camera.toWorld[3] = Vec4(0.2f, 2.0f, 1.0f, 1);
    const float tilt = -0.5f;
    camera.toWorld[1] = Vec4(0, std::cos(tilt), std::sin(tilt), 0), camera.toWorld[2] = Vec4(0, -std::sin(tilt), std::cos(tilt), 0);
    camera.yfov = 1.0f;
    camera.centre = Vec2(0.1f, -0.07f);
    camera.optics.pixelAspect = 1.2f;
    camera.optics.panorama = panorama;
    if (panorama) e = {240, 120, 1};
    PlaneView v;
    v.width = e.width, v.height = e.height;
    v.normal = Vec3(0, 1, 0);
    g = planeGBuffer(v);
    const auto P = g->writable<float>("P"), footprint = g->writable<float>("footprint"), depth = g->writable<float>("depth");
    const auto instance = g->writable<uint32_t>("instance");
    for (int y = 0; y < e.height; ++y)
      for (int x = 0; x < e.width; ++x) {
        const Ray ray = cameraRay(camera, e.width, e.height, float(x) + 0.5f, float(y) + 0.5f);
        const float far = -ray.origin.y / ray.direction.y;
        const size_t k = size_t(y * e.width + x);
        const Vec3 p = ray.origin + far * ray.direction;
        const bool hit = far > 0 && far < 30;
        instance[k] = hit ? 0 : ~0u;
        depth[k] = hit ? far : std::numeric_limits<float>::infinity();
        footprint[k] = hit ? pixelFootprint(camera, e.height, far) : 0;
        for (int c = 0; c < 3; ++c) P[3 * k + size_t(c)] = hit ? p[c] : 0;
      }
  }
};

TEST(StyleElongation, IsOfTheWorldInPerspectiveAndInAPanorama) {
  for (const bool panorama : {false, true}) {
    const Ground ground(panorama);
    StyleElongationSettings s;
    s.extent = ground.e;
    s.camera = ground.camera;
    s.length = 1.2f;
    for (const float degrees : {10.0f, 100.0f, 200.0f, 290.0f}) {
      const double a = double(degrees) * M_PI / 180;
      const DVec3 way(std::cos(a), 0, std::sin(a)), c(0.3, 0, -1.8);
      s.light = {glm::normalize(Vec3(way) + Vec3(0, -1, 0)), true};
      const auto P = ground.g->floats("P");
      const auto D = floatTerm(ground.e, "D", [&](int x, int y, int) {
        const size_t k = size_t(y * ground.e.width + x);
        return ground.g->plane<uint32_t>("instance")[k] == ~0u ? kStyleFar : float(glm::length(DVec3(P[3 * k], P[3 * k + 1], P[3 * k + 2]) - c) - 0.5);
      });
      const auto out = runFilter(makeStyleElongationNode(s), {D, ground.g});
      size_t tested = 0;
      for (size_t k = 0; k < ground.e.elements(); ++k) {
        if (ground.g->plane<uint32_t>("instance")[k] == ~0u) {
          ASSERT_EQ(out->floats("D")[k], kStyleFar);
          continue;
        }
        const DVec3 x(P[3 * k], P[3 * k + 1], P[3 * k + 2]);
        const double exact = toSegment(x, c, c + 1.2 * way) - 0.5;
        if (std::abs(exact) > 0.3 || glm::length(x - c) > 2.5) continue;
        ++tested;
        ASSERT_NEAR(double(out->floats("D")[k]), exact, 0.3 * double(ground.g->floats("footprint")[k])) << degrees << (panorama ? " panorama" : "");
      }
      EXPECT_GT(tested, 150u) << panorama;
    }
  }
}

TEST(StyleElongation, WalksPassWhatStandsBefore) {  // a pole of 10 samples before the table, between disc and streak
  Table t;
  t.s.light = sun(0);
  t.s.length = 4;
  const auto free = t.drawn(t.disc(DVec3(3, -6.4, 0)));
  const auto P = t.g->writable<float>("P");
  const auto instance = t.g->writable<uint32_t>("instance");
  const auto pole = [](size_t k) { return k % 128 >= 50 && k % 128 < 60; };
  auto D = t.disc(DVec3(3, -6.4, 0));
  for (size_t k = 0; k < t.e.elements(); ++k)
    if (pole(k)) P[3 * k + 2] = 2.0f, instance[k] = 1, D->writable<float>("D")[k] = -7.0f;
  const auto out = t.drawn(D);
  for (size_t k = 0; k < out.size(); ++k) {
    if (pole(k)) {
      ASSERT_NEAR(out[k], -7.0f, 1e-5f) << "the pole's own";
      continue;
    }
    if (k % 128 < 70) { ASSERT_NEAR(out[k], free[k], 0.3f * kPixel) << k; }  // from where walks reach the disc's middle
  }
  // What is turned away does not count: the same pole lying in the table's plane with its normal across.
  const auto N = t.g->writable<float>("N");
  for (size_t k = 0; k < t.e.elements(); ++k)
    if (pole(k)) P[3 * k + 2] = 0.0f, N[3 * k] = 1, N[3 * k + 2] = 0;
  const auto turned = t.drawn(D);
  for (size_t k = 0; k < turned.size(); ++k)
    if (!pole(k) && k % 128 < 70) { ASSERT_NEAR(turned[k], free[k], 0.3f * kPixel) << k; }
}

TEST(StyleElongation, FollowsSurfacesThatBend) {  // a cylinder of radius 4 about y seen along -z: D and walks along its arc
  Table t(128, 16);
  t.s.angle = 3.0f;
  t.s.length = 2;
  const double R = 8;
  const auto P = t.g->writable<float>("P"), N = t.g->writable<float>("N"), Ng = t.g->writable<float>("Ng");
  auto D = floatTerm(t.e, "D", [](int, int, int) { return 0.0f; });
  std::vector<double> arc(t.e.elements());
  for (size_t k = 0; k < t.e.elements(); ++k) {
    const double x = double(P[3 * k]) - 6.35, a = std::asin(x / R);
    P[3 * k + 2] = float(R * std::cos(a) - R);
    N[3 * k] = Ng[3 * k] = float(x / R), N[3 * k + 2] = Ng[3 * k + 2] = float(std::cos(a));
    arc[k] = R * a;
    D->writable<float>("D")[k] = float(arc[k] + 4.0);
  }
  t.s.light = {Vec3(1, 0, 0), true};
  const auto out = t.drawn(D);
  for (size_t k = 0; k < out.size(); ++k) {
    if (std::abs(arc[k]) < 0.2 || arc[k] - 2 < -6.9) continue;  // light along the normal; the picture's border
    ASSERT_NEAR(double(out[k]), arc[k] + 4.0 - 2.0, double(kPixel)) << k << " arc " << arc[k];
  }
}

TEST(StyleElongation, EndsAtThePicturesBorderAndKnowsItsPlaceInIt) {
  Table t;
  t.s.light = sun(0);
  const auto whole = t.drawn(t.disc(DVec3(6, -6.4, 0)));
  Table part;
  const int x0 = 30, y0 = 25, w = 90, h = 80;
  part.s.place = {x0, y0, 128, 128};
  part.e = part.s.extent = {w, h, 1};
  part.s.light = t.s.light;
  const auto D = cropTerm(*t.disc(DVec3(6, -6.4, 0)), x0, y0, w, h), g = cropTerm(*t.g, x0, y0, w, h);
  const TermPtr made = runFilter(makeStyleElongationNode(part.s), {D, g});
  const auto out = made->floats("D");
  for (int y = 0; y < h; ++y)
    for (int x = 31; x < w; ++x) ASSERT_NEAR(out[size_t(y * w + x)], whole[size_t((y + y0) * 128 + x + x0)], 1e-5f) << x << " " << y;
  EXPECT_EQ(out[0], D->floats("D")[0]) << "nothing is known of what lies before the border";
}

TEST(StyleElongation, AnyScaleSizeAndNumberOfThreads) {
  for (const float scale : {1e-6f, 1.0f, 1e6f}) {
    Table t(96, 64, scale);
    t.s.light = sun(40);
    const auto D = t.distances([&](const DVec3& P) { return (glm::length(P / double(scale) - DVec3(4, -3, 0)) - kRadius) * double(scale); });
    const auto one = t.drawn(D, 1), many = t.drawn(D, 4);
    Table plain(96, 64);
    plain.s.light = t.s.light;
    const auto expected = plain.drawn(plain.disc(DVec3(4, -3, 0)));
    for (size_t k = 0; k < one.size(); ++k) {
      ASSERT_EQ(std::bit_cast<uint32_t>(one[k]), std::bit_cast<uint32_t>(many[k]));
      ASSERT_NEAR(one[k] / scale, expected[k], 2e-4f) << scale;
    }
  }
  for (const auto& [w, h] : {std::pair{1, 1}, std::pair{1, 7}, std::pair{9, 1}}) {
    Table t(w, h);
    t.s.light = sun(40);
    for (const float d : t.drawn(t.disc(DVec3(0, 0, 0)))) ASSERT_TRUE(std::isfinite(d));
  }
  Table t;  // distances of nothing are no numbers to go between
  t.s.light = sun(0);
  auto D = t.disc(DVec3(6, -6, 0));
  for (size_t k = 0; k < t.e.elements(); k += 3) D->writable<float>("D")[k] = k % 2 ? kStyleFar : -kStyleFar;
  for (const float d : t.drawn(D)) ASSERT_TRUE(std::isfinite(d) && std::abs(d) <= kStyleFar && (std::abs(d) == kStyleFar || std::abs(d) < 20));
}

}  // namespace stylised_elongation_test
}  // namespace gobo

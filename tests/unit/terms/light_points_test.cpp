// SPDX-License-Identifier: Apache-2.0
// Lights at infinity of some size: where their points lie and what they weigh.
#include "terms/light_points.h"

#include <gtest/gtest.h>

#include "scene/light_axes.h"
#include "support/lit_scene.h"

namespace gobo {
namespace {

TEST(LightPoints, WideDirectionalLightsFillTheirSquare) {
  test::LitScene lit;
  LightShape sun;
  sun.kind = LightKind::Directional;
  sun.axis = glm::normalize(Vec3(-1, -2, 0.5f));
  sun.u = glm::normalize(glm::cross(sun.axis, Vec3(0, 1, 0)));
  lit.add(sun);
  lit.build();
  const std::vector<int> subset{0};
  const SceneView view(*lit.scene, Facet::LightShape, subset);
  EXPECT_TRUE(LightPoints(view, 0).pointLike());
  const double a = 0.4, b = 0.1;  // tangents of half the angles
  sun.skyRectangle = Vec2(float(2 * a), float(2 * b));
  test::LitScene wide;
  wide.add(sun);
  wide.build();
  const SceneView wideView(*wide.scene, Facet::LightShape, subset);
  const LightPoints light(wideView, 0);
  EXPECT_FALSE(light.pointLike());
  const Vec3 up = glm::cross(sun.axis, sun.u);
  double sum = 0, x = 0, y = 0;
  const int n = 64;
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i) {
      LightPoint p;
      ASSERT_TRUE(light.sample(Vec3(1, 2, 3), -sun.axis, -sun.axis, Vec2((i + 0.5f) / n, (j + 0.5f) / n), p));
      const double along = -glm::dot(p.direction, sun.axis);
      x = std::max(x, std::fabs(glm::dot(p.direction, sun.u)) / along);
      y = std::max(y, std::fabs(glm::dot(p.direction, up)) / along);
      sum += p.weight / double(n * n);
    }
  EXPECT_NEAR(x, a, a / n);  // u is the wide side: the map and the light agree on what lies along which axis
  EXPECT_NEAR(y, b, b / n);
  // Weights are the solid angle of the square by the cosine: a rectangle's irradiance on a plane that faces it (Lambert 1760).
  const double s = std::sqrt(1 + a * a), t = std::sqrt(1 + b * b);
  EXPECT_NEAR(sum * 4 * a * b, 2 * (a / s * std::atan(b / s) + b / t * std::atan(a / t)), 1e-5);
}

// Equal shares of the disk's solid angle, weighed by the cosine at the receiver: their mean is the irradiance over the solid angle.
TEST(LightPoints, SunsFillTheirDisk) {
  test::LitScene lit;
  LightShape sun;
  sun.kind = LightKind::Directional;
  sun.axis = glm::normalize(Vec3(-1, -2, 0.5f));
  sun.angularSize = 0.8f;
  lit.add(sun);
  lit.build();
  const std::vector<int> subset{0};
  const SceneView view(*lit.scene, Facet::LightShape, subset);
  const LightPoints light(view, 0);
  EXPECT_FALSE(light.pointLike());
  const Vec3 n = glm::normalize(Vec3(0.2f, 1, 0));
  double sum = 0, least = 1, inner = 0;
  const int side = 64;
  for (int j = 0; j < side; ++j)
    for (int i = 0; i < side; ++i) {
      LightPoint p;
      ASSERT_TRUE(light.sample(Vec3(1, 2, 3), n, n, Vec2((i + 0.5f) / side, (j + 0.5f) / side), p));
      EXPECT_GE(p.distance, 3e38f);
      const double along = -glm::dot(p.direction, sun.axis);
      least = std::min(least, along);
      inner += 1 - along < 0.5625 * (1 - std::cos(0.4)) ? 1.0 / (side * side) : 0.0;
      sum += p.weight / double(side * side);
    }
  EXPECT_NEAR(least, 1 - sqr(63.0 / 64) * (1 - std::cos(0.4)), 1e-6);  // the outermost ring of points
  EXPECT_NEAR(inner, 0.5625, 1e-9);                                    // the inner 24 of 32 rings of points
  const double solidAngle = 2 * M_PI * (1 - std::cos(0.4)), cosine = -glm::dot(n, sun.axis);
  EXPECT_NEAR(sum * solidAngle, M_PI * sqr(std::sin(0.4)) * cosine, 1e-4);
}

TEST(LightPoints, MapAxesFollowTheLight) {
  LightShape s;
  s.kind = LightKind::Directional;
  s.axis = Vec3(0, 0, -1);
  s.u = glm::normalize(Vec3(1, 2, 0));
  EXPECT_NEAR(glm::dot(mapFrame(s).x, s.u), 1.0, 1e-6);
  s.u = glm::normalize(Vec3(1, 0, 1));  // not perpendicular: says nothing
  const Frame f = mapFrame(s);
  EXPECT_EQ(f.x, Frame(s.axis).x);
  EXPECT_NEAR(glm::dot(f.x, f.z), 0.0, 1e-6);
  s.u = Vec3(0.0f);
  EXPECT_EQ(mapFrame(s).x, Frame(s.axis).x);
}

// Where it says that nothing can arrive no point shines, and it says so of many places where none does.
TEST(LightPoints, WhatIsSurelyDarkHasNoPoint) {
  test::LitScene lit;
  LightShape sun;
  sun.kind = LightKind::Directional;
  sun.axis = glm::normalize(Vec3(-1, -2, 0.5f));
  for (const float size : {0.01f, 0.3f, 1.0f}) {
    sun.angularSize = size;
    lit.add(sun);
  }
  for (const bool twoSided : {false, true}) lit.add(test::rectLight(Vec3(0.3f, 1, 0), Vec3(0.5f, 0.1f, 0), Vec3(0, 0, 1.5f), twoSided));
  lit.add(test::diskLight(Vec3(0, 0.5f, 0.2f), Vec3(1, 1, 0), 0.4f));
  lit.add(test::sphereLight(Vec3(0, 0.5f, 0.2f), 0.7f));
  lit.build();
  std::vector<int> subset(lit.scene->lights.size());
  std::iota(subset.begin(), subset.end(), 0);
  const SceneView view(*lit.scene, Facet::LightShape, subset);
  for (const int l : subset) {
    const LightPoints light(view, l);
    int dark = 0, none = 0;
    for (uint32_t i = 0; i < 2000; ++i) {
      SobolSampler at(5, i);
      const Vec2 a = at.next2D(), b = at.next2D(), c = at.next2D();
      const Vec3 p = 4.0f * Vec3(a.x, a.y, b.x) - Vec3(2.0f);
      const float z = 2 * b.y - 1, r = std::sqrt(std::max(1 - z * z, 0.0f));
      const Vec3 N(r * std::cos(6.2831853f * c.x), z, r * std::sin(6.2831853f * c.x));
      bool shines = false;
      LightPoint point;
      for (uint32_t k = 0; k < 256 && !shines; ++k) shines = light.sample(p, N, N, SobolSampler(9, k).next2D(), point);
      const bool says = light.surelyDark(p, N);
      EXPECT_FALSE(says && shines) << l << " " << i;
      dark += says;
      none += !shines;
    }
    EXPECT_GT(dark, none / 8) << l;  // a sphere around a long lamp is wide
    EXPECT_GT(none, 20) << l;
  }
}

}  // namespace
}  // namespace gobo

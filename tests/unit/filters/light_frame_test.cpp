// SPDX-License-Identifier: Apache-2.0
// Light frames: the map and its rays are inverse to each other, everything in the bounds is covered, degenerate bounds hold.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "base/sobol.h"
#include "filters/shadow_map/light_frame.h"

namespace {

using namespace gobo;

LightShape lightOf(LightKind kind, Vec3 position, Vec3 axis) {
  LightShape l;
  l.kind = kind;
  l.position = position;
  l.axis = glm::normalize(axis);
  l.cosOuter = std::cos(0.7f);
  return l;
}

struct Mapped {
  double u, v, d, w;
};
Mapped map(const LightFrame& f, const Vec3& P) {
  const auto r = f.rows();
  const Vec4 p(P - f.origin, 1.0f);
  const double w = glm::dot(r.w, p);
  return {glm::dot(r.u, p) / w, glm::dot(r.v, p) / w, glm::dot(r.d, p), w};
}

TEST(LightFrame, RaysAndMapAreInverse) {
  const Vec3 lo(-3, -1, -2), hi(2, 4, 3);
  for (const LightShape& light : {lightOf(LightKind::Directional, {}, {0.2f, -1, 0.3f}), lightOf(LightKind::Directional, {}, {0, 0, -1}),
                                  lightOf(LightKind::Spot, {1, 9, 0}, {0, -1, 0.1f}), lightOf(LightKind::Rect, {0, 3, 0}, {0, -1, 0}),
                                  lightOf(LightKind::Disk, {10, 2, 0}, {-1, 0, 0})}) {
    const auto made = fitLightFrame(light, lo, hi, 256, 3);
    ASSERT_TRUE(made.ok()) << made.status().toString();
    EXPECT_LT(made->near, made->far);
    for (int i = 0; i < 100; ++i) {
      const float u = toUnit(hash32(1, i)), v = toUnit(hash32(2, i)), t = 0.5f + 8.0f * toUnit(hash32(3, i));
      float start, cosine;
      const Ray ray = made->ray(u, v, start, cosine);
      EXPECT_NEAR(glm::length(ray.direction), 1.0f, 1e-5f);
      const Mapped m = map(*made, ray.origin + ray.direction * t);
      EXPECT_NEAR(m.u, u, 2e-5);
      EXPECT_NEAR(m.v, v, 2e-5);
      EXPECT_NEAR(m.d, (start + t * cosine - made->near) / (made->far - made->near), 2e-5);
      EXPECT_GT(m.w, 0.0);
    }
  }
}

TEST(LightFrame, DirectionalCoversTheBoundsTightly) {
  const Vec3 lo(-3, 0, -2), hi(5, 2, 7);
  const auto f = fitLightFrame(lightOf(LightKind::Directional, {}, {0.5f, -1, 0.1f}), lo, hi, 512, 4);
  ASSERT_TRUE(f.ok());
  double least = 1, most = 0;
  for (int c = 0; c < 8; ++c) {
    const Mapped m = map(*f, Vec3(c & 1 ? hi.x : lo.x, c & 2 ? hi.y : lo.y, c & 4 ? hi.z : lo.z));
    EXPECT_GE(std::min(m.u, m.v), 4.0 / 512 - 1e-4);  // the rim stays free
    EXPECT_LE(std::max(m.u, m.v), 1.0 - 4.0 / 512 + 1e-4);
    EXPECT_TRUE(m.d >= 0.0 && m.d <= 1.0);
    least = std::min(least, m.d);
    most = std::max(most, m.d);
  }
  EXPECT_LT(least, 0.01);
  EXPECT_GT(most, 0.99);
}

TEST(LightFrame, AreaLightInsideTheSceneCovers150Degrees) {
  const auto f = fitLightFrame(lightOf(LightKind::Rect, {0, 2.9f, 0}, {0, -1, 0}), Vec3(-3), Vec3(3), 512, 0);
  ASSERT_TRUE(f.ok());
  const float inside = std::tan(74.0f * kPi / 180.0f), outside = std::tan(76.0f * kPi / 180.0f);
  const Vec3 base = f->origin + f->forward;
  EXPECT_TRUE(map(*f, base + f->right * inside).u < 1.0);
  EXPECT_TRUE(map(*f, base + f->right * outside).u > 1.0);
}

// Lamps in random rooms, turned at random: edges of the box come from behind them, and are seen far to either side.
TEST(LightFrame, CoversEveryWallInFrontOfATiltedLight) {
  uint64_t n = 0;
  const auto random = [&](float lo, float hi) { return lo + (hi - lo) * toUnit(hash32(71, n++)); };
  constexpr float degree = kPi / 180.0f;
  int seen = 0, tight = 0;
  for (int room = 0; room < 300; ++room) {
    Vec3 lo, hi, at, axis;
    for (int k = 0; k < 3; ++k) {
      lo[k] = random(-5, 5);
      hi[k] = lo[k] + random(0.2f, 8);
      at[k] = room % 5 ? random(lo[k], hi[k]) : random(lo[k] - 2, hi[k] + 2);  // one of five may be outside
      axis[k] = random(-1, 1);
    }
    axis = glm::normalize(axis);
    for (const LightKind kind : {LightKind::Rect, LightKind::Disk, LightKind::Spot}) {
      LightShape light = lightOf(kind, at, axis);
      const float cone = random(5, 89) * degree;
      light.cosOuter = std::cos(cone);
      const auto f = fitLightFrame(light, lo, hi, 512, 0);
      ASSERT_TRUE(f.ok()) << f.status().toString();
      const float widest = std::min(kind == LightKind::Spot ? cone : 90 * degree, kMaxHalfAngle) - 0.5f * degree;
      tight += f->hi.x - f->lo.x < 1.9f * std::tan(widest);
      for (int i = 0; i < 200; ++i) {
        Vec3 p;  // inside, or on a wall, an edge, a corner
        for (int k = 0; k < 3; ++k) p[k] = std::clamp(random(lo[k] - 0.5f * (hi[k] - lo[k]), hi[k] + 0.5f * (hi[k] - lo[k])), lo[k], hi[k]);
        const Vec3 d = p - at;
        if (!(glm::dot(d, axis) > 1e-3f && glm::dot(d, axis) > std::cos(widest) * glm::length(d))) continue;
        ++seen;
        const Mapped m = map(*f, p);
        EXPECT_TRUE(m.u >= 0 && m.u <= 1 && m.v >= 0 && m.v <= 1 && m.d >= 0 && m.d <= 1)
            << "room " << room << ", kind " << int(kind) << ": " << m.u << " " << m.v << " " << m.d;
      }
    }
  }
  EXPECT_GT(seen, 20000);
  EXPECT_GT(tight, 50) << "windows that are always whole would cover all";
}

TEST(LightFrame, SpotSeesNoMoreThanItsCone) {
  const auto f = fitLightFrame(lightOf(LightKind::Spot, {0, 5, 0}, {0, -1, 0}), Vec3(-30, 0, -30), Vec3(30, 1, 30), 512, 0);
  ASSERT_TRUE(f.ok());
  EXPECT_NEAR(f->hi.x, std::tan(0.7f), 1e-3);
  const auto small = fitLightFrame(lightOf(LightKind::Spot, {0, 5, 0}, {0, -1, 0}), Vec3(-0.1f, 0, -0.1f), Vec3(0.1f, 1, 0.1f), 512, 0);
  ASSERT_TRUE(small.ok());
  EXPECT_LT(small->hi.x, 0.03f);  // tight around a small scene
}

TEST(LightFrame, CubeFacesCoverEveryDirection) {
  // Each direction falls well inside the face that cubeFace() names, a rim and the texel of bilinear lookups away from its border, and
  // comes back along the face's ray.
  const int resolution = 64, rim = 3;
  for (LightKind kind : {LightKind::Point, LightKind::Sphere}) {
    const Vec3 at(1, 2, 0.5f);
    const auto made = fitLightFrames(lightOf(kind, at, {0, -1, 0}), Vec3(-3, -1, -2), Vec3(2, 4, 3), resolution, rim);
    ASSERT_TRUE(made.ok()) << made.status().toString();
    ASSERT_EQ(made->count, 6);
    int seen[6] = {};
    for (int i = 0; i < 3000; ++i) {
      const Vec3 p = 2.0f * Vec3(toUnit(hash32(1, i)), toUnit(hash32(2, i)), toUnit(hash32(3, i))) - 1.0f;
      const int face = cubeFace(p);
      ++seen[face];
      const Mapped m = map(made->face[size_t(face)], at + p);
      EXPECT_GT(m.w, 0.0);
      for (double u : {m.u, m.v}) {
        EXPECT_GT(u * resolution - 0.5, rim);
        EXPECT_LT(u * resolution - 0.5, resolution - 1 - rim);
      }
      float start, cosine;
      const Ray ray = made->face[size_t(face)].ray(float(m.u), float(m.v), start, cosine);
      EXPECT_NEAR(glm::dot(ray.direction, glm::normalize(p)), 1.0f, 1e-5f);
    }
    for (int n : seen) EXPECT_GT(n, 300);
  }
  EXPECT_EQ(cubeFace(Vec3(1, 1, 1)), 0);  // ties go to the earlier axis
  EXPECT_EQ(cubeFace(Vec3(0, -1, -1)), 3);
}

TEST(LightFrame, DegenerateBounds) {
  const float inf = std::numeric_limits<float>::infinity();
  for (LightKind kind : {LightKind::Directional, LightKind::Spot, LightKind::Rect, LightKind::Disk}) {
    const LightShape light = lightOf(kind, {0, 1, 0}, {0, -1, 0});
    struct Box {
      Vec3 lo, hi;
    };
    for (const Box& b : {Box{Vec3(1), Vec3(-1)}, Box{Vec3(0), Vec3(0)}, Box{Vec3(-1, 0, -1), Vec3(1, 0, 1)}, Box{Vec3(-1, 5, -1), Vec3(1, 6, 1)},
                         Box{Vec3(1e6f), Vec3(1e6f)}, Box{Vec3(-1e9f), Vec3(1e9f)}}) {
      const auto f = fitLightFrame(light, b.lo, b.hi, 4, 3);
      ASSERT_TRUE(f.ok()) << f.status().toString();
      EXPECT_LT(f->near, f->far);
      EXPECT_LT(f->lo.x, f->hi.x);
      const auto r = f->rows();
      for (const Vec4& row : {r.u, r.v, r.w, r.d}) EXPECT_TRUE(std::isfinite(row.x + row.y + row.z + row.w));
    }
    EXPECT_EQ(fitLightFrame(light, Vec3(0), Vec3(inf), 4, 0).status().code(), Code::InvalidArgument);
  }
  EXPECT_EQ(fitLightFrame(lightOf(LightKind::Point, {}, {0, -1, 0}), Vec3(0), Vec3(1), 4, 0).status().code(), Code::Unimplemented);
  LightShape broken = lightOf(LightKind::Spot, {0, 1, 0}, {0, -1, 0});
  broken.position.x = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(fitLightFrame(broken, Vec3(0), Vec3(1), 4, 0).status().code(), Code::InvalidArgument);
}

}  // namespace

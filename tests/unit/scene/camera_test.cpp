// SPDX-License-Identifier: Apache-2.0
// Cameras: where rays go and where points are seen are inverses for every kind; intrinsics are the K matrix of a pinhole; a panorama's rays are those of
// pinholes that look the same way; clipping planes lie where they are said to lie.
#include <gtest/gtest.h>

#include <bit>
#include <random>

#include "scene/camera.h"
#include "scene/ray_packet.h"

namespace gobo::camera_test {
namespace {

constexpr int kCases = 400;

double between(std::mt19937& random, double lo, double hi) { return lo + (hi - lo) * (double(random()) / 4294967296.0); }

/// Any kind, anywhere, turned anyhow. Seed: the case.
Camera randomCamera(std::mt19937& random, int width, int height) {
  Camera c;
  const auto number = [&](double lo, double hi) { return float(between(random, lo, hi)); };
  const Vec3 back = glm::normalize(Vec3(number(-1, 1), number(-1, 1), number(0.1, 1)));
  const Vec3 right = glm::normalize(glm::cross(Vec3(number(-0.3, 0.3), 1, number(-0.3, 0.3)), back));
  c.toWorld = Mat4(Vec4(right, 0), Vec4(glm::cross(back, right), 0), Vec4(back, 0), Vec4(number(-5, 5), number(-5, 5), number(-5, 5), 1));
  c.centre = Vec2(number(-0.3, 0.3), number(-0.3, 0.3));
  switch (random() % 4) {
    case 0: c.yfov = number(0.2, 2.5); break;
    case 1:
      c.perspective = false;
      c.yheight = number(0.5, 20);
      break;
    case 2:
      c.optics.focal = between(random, 0.2, 5.0);
      c.optics.pixelAspect = number(0.5, 2.0);
      break;
    default: c.optics.panorama = true; break;
  }
  (void)width, (void)height;
  return c;
}

TEST(Camera, WhereARayGoesItsPointsAreSeen) {
  for (int seed = 0; seed < kCases; ++seed) {
    std::mt19937 random{uint32_t(seed)};
    const int width = 16 + int(random() % 300), height = 16 + int(random() % 300);
    const Camera c = randomCamera(random, width, height);
    const glm::dvec2 asked(between(random, 0.5, width - 0.5), between(random, 0.5, height - 0.5));
    const Ray ray = cameraRay(c, width, height, float(asked.x), float(asked.y));
    EXPECT_NEAR(glm::length(ray.direction), 1.0f, 1e-6f);
    const double t = between(random, 1.0, 30.0);
    glm::dvec2 seen;
    ASSERT_TRUE(filmPosition(c, width, height, glm::dvec4(DVec3(ray.origin) + t * DVec3(ray.direction), 1.0), seen)) << seed;
    // Near its poles a panorama's columns lie close together: there a rounded direction is many pixels wide.
    const double polar = c.optics.panorama ? std::sin(M_PI * asked.y / height) : 1.0;
    EXPECT_NEAR(seen.x, asked.x, 2e-3 / polar) << seed;
    EXPECT_NEAR(seen.y, asked.y, 2e-3) << seed;
    if (c.perspective) {
      ASSERT_TRUE(filmPosition(c, width, height, glm::dvec4(DVec3(ray.direction), 0.0), seen)) << seed;
      EXPECT_NEAR(seen.x, asked.x, 2e-3 / polar) << seed;
      EXPECT_NEAR(seen.y, asked.y, 2e-3) << seed;
    }
  }
}

TEST(Camera, TheMatrixToThePictureIsWhereItIsSeen) {
  for (int seed = 0; seed < kCases; ++seed) {
    std::mt19937 random{uint32_t(1000 + seed)};
    const int width = 64, height = 48;
    const Camera c = randomCamera(random, width, height);
    if (c.optics.panorama) continue;
    const Ray ray = cameraRay(c, width, height, float(between(random, 1, 63)), float(between(random, 1, 47)));
    const Vec4 p = worldToNdc(c, width, height) * Vec4(ray.origin + ray.direction * 4.0f, 1.0f);
    glm::dvec2 seen;
    ASSERT_TRUE(filmPosition(c, width, height, glm::dvec4(DVec3(ray.origin + ray.direction * 4.0f), 1.0), seen));
    EXPECT_NEAR(p.x / p.w * width, seen.x, 5e-3) << seed;
    EXPECT_NEAR(p.y / p.w * height, seen.y, 5e-3) << seed;
  }
}

TEST(Camera, SixPinholesSeeWhatThePanoramaSees) {
  for (int seed = 0; seed < 50; ++seed) {
    std::mt19937 random{uint32_t(2000 + seed)};
    Camera around = randomCamera(random, 0, 0);
    around.perspective = true;
    around.optics = {};
    around.centre = Vec2(0.0f);
    const Vec3 right(around.toWorld[0]), up(around.toWorld[1]), back(around.toWorld[2]);
    struct Face {
      Vec3 right, up, back;
    };
    // Front, right, behind, left, up, down, of 90 degrees each.
    const Face faces[] = {{right, up, back}, {back, up, -right}, {-right, up, -back}, {-back, up, right}, {right, back, -up}, {right, -back, up}};
    Camera panorama = around;
    panorama.optics.panorama = true;
    const int W = 512, H = 256;
    for (const Face& f : faces) {
      Camera c = around;
      c.yfov = kPi / 2;
      c.toWorld = Mat4(Vec4(f.right, 0), Vec4(f.up, 0), Vec4(f.back, 0), around.toWorld[3]);
      const float x = float(between(random, 1, 63)), y = float(between(random, 1, 63));
      const Ray ray = cameraRay(c, 64, 64, x, y);
      glm::dvec2 seen;
      ASSERT_TRUE(filmPosition(panorama, W, H, glm::dvec4(DVec3(ray.direction), 0.0), seen));
      EXPECT_GT(glm::dot(cameraRay(panorama, W, H, float(seen.x), float(seen.y)).direction, ray.direction), 1.0f - 2e-6f);
    }
    // The middle looks as the camera does; a quarter to the right is its right; the top row is up.
    EXPECT_GT(glm::dot(cameraRay(panorama, W, H, 256, 128).direction, -back), 1.0f - 1e-6f);
    EXPECT_GT(glm::dot(cameraRay(panorama, W, H, 384, 128).direction, right), 1.0f - 1e-6f);
    EXPECT_GT(glm::dot(cameraRay(panorama, W, H, 100, 0).direction, up), 1.0f - 1e-6f);
  }
}

TEST(Camera, RaysBeginAndEndAtTheClippingPlanes) {
  for (int seed = 0; seed < kCases; ++seed) {
    std::mt19937 random{uint32_t(3000 + seed)};
    const int width = 80, height = 60;
    Camera c = randomCamera(random, width, height);
    const float x = float(between(random, 0, width)), y = float(between(random, 0, height));
    const Ray open = cameraRay(c, width, height, x, y);
    EXPECT_EQ(open.tmin, 0.0f);
    EXPECT_GE(open.tmax, CameraOptics::kNoEnd);
    c.optics.clipNear = float(between(random, 0.1, 3));
    c.optics.clipFar = c.optics.clipNear + float(between(random, 0.1, 30));
    const Ray ray = cameraRay(c, width, height, x, y);
    EXPECT_EQ(ray.direction, open.direction);
    const Vec3 eye(c.toWorld[3]), axis(-Vec3(c.toWorld[2]));
    const auto depth = [&](float t) { return c.optics.panorama ? t : glm::dot(ray.origin + ray.direction * t - eye, axis); };
    EXPECT_NEAR(depth(ray.tmin), c.optics.clipNear, 2e-5f * c.optics.clipNear + 1e-5f) << seed;
    EXPECT_NEAR(depth(ray.tmax), c.optics.clipFar, 2e-5f * c.optics.clipFar + 1e-5f) << seed;
  }
}

// Axes whose squares round to 1 and beside it: what is 1 by construction may not be left to rounding.
TEST(Camera, PacketsAreSingleRaysBitForBit) {
  int beside = 0;
  for (const bool perspective : {true, false})
    for (int k = 0; k < 40; ++k) {
      Camera c;
      const Frame f(glm::normalize(Vec3(0.03f * float(k) - 0.5f, 0.17f, 1.0f)));
      c.toWorld = Mat4(Vec4(f.x, 0), Vec4(f.y, 0), Vec4(f.z, 0), Vec4(0.4f, 1.2f, 7.0f, 1));
      c.perspective = perspective, c.yheight = 5.0f;
      c.optics.clipNear = 5.5f, c.optics.clipFar = 9.7f;
      c.centre = Vec2(0.1f, -0.2f);
      const FilmRays film(c, 37, 23);
      float px[RayPacket::kLanes], py[RayPacket::kLanes];
      for (int i = 0; i < RayPacket::kLanes; ++i) px[i] = 2.3f * float(i), py[i] = 1.7f * float(RayPacket::kLanes - i);
      RayPacket rays;
      filmPacket(film, px, py, rays);
      beside += glm::dot(f.z, f.z) != 1.0f;
      for (int i = 0; i < RayPacket::kLanes; ++i) {
        const Ray one = film.at(px[i], py[i]);
        EXPECT_EQ(std::bit_cast<uint32_t>(rays.tmin[i]), std::bit_cast<uint32_t>(one.tmin)) << k;
        EXPECT_EQ(std::bit_cast<uint32_t>(rays.tmax[i]), std::bit_cast<uint32_t>(one.tmax)) << k;
        for (int d = 0; d < 3; ++d) {
          EXPECT_EQ(std::bit_cast<uint32_t>(rays.origin[d][i]), std::bit_cast<uint32_t>(one.origin[d])) << k;
          EXPECT_EQ(std::bit_cast<uint32_t>(rays.direction[d][i]), std::bit_cast<uint32_t>(one.direction[d])) << k;
        }
      }
    }
  EXPECT_GT(beside, 3);
}

TEST(Camera, RaysThroughALensMeetThePinholesRayInThePlaneOfFocus) {
  for (int seed = 0; seed < kCases; ++seed) {
    std::mt19937 random{uint32_t(4000 + seed)};
    const int width = 80, height = 60;
    Camera c = randomCamera(random, width, height);
    if (c.optics.panorama) continue;
    c.optics.clipNear = float(between(random, 0.1, 1));
    const float x = float(between(random, 0, width)), y = float(between(random, 0, height));
    const Ray pinhole = cameraRay(c, width, height, x, y);
    c.optics.lensRadius = float(between(random, 0.01, 2));
    c.optics.focus = float(between(random, 0.5, 20));
    const FilmRays film(c, width, height);
    EXPECT_EQ(film.at(x, y).direction, pinhole.direction) << seed;
    EXPECT_EQ(film.at(x, y).tmin, pinhole.tmin) << seed;
    const float angle = float(between(random, 0, 6.28)), share = float(between(random, 0.1, 1));
    const Ray ray = film.at(x, y, share * Vec2(std::cos(angle), std::sin(angle)));
    const Vec3 axis(-Vec3(c.toWorld[2])), eye(c.toWorld[3]);
    EXPECT_NEAR(glm::length(ray.origin - pinhole.origin), share * c.optics.lensRadius, 1e-5f) << seed;
    EXPECT_NEAR(glm::dot(ray.origin - pinhole.origin, axis), 0.0f, 1e-5f) << seed;
    const auto at = [&](const Ray& r, float depth) { return r.origin + r.direction * (depth / glm::dot(r.direction, axis)); };
    const Vec3 sharp = at(pinhole, c.optics.focus);
    EXPECT_NEAR(glm::length(at(ray, c.optics.focus) - sharp), 0.0f, 1e-5f * (1.0f + glm::length(sharp - eye))) << seed;
    EXPECT_GT(glm::length(at(ray, 2.0f * c.optics.focus) - at(pinhole, 2.0f * c.optics.focus)), 0.9f * share * c.optics.lensRadius) << seed;
    EXPECT_NEAR(glm::dot(ray.origin + ray.direction * ray.tmin - eye, axis), c.optics.clipNear, 1e-5f) << seed;
  }
}

TEST(Camera, OpticsAreInKeysWhereThereAreAnyAndNowhereElse) {
  const auto key = [](const Camera& c) {
    Hasher h("camera");
    hashOptics(h, c);
    return h.digest();
  };
  const Camera plain;
  EXPECT_EQ(key(plain), Hasher("camera").digest());
  std::vector<Camera> others(7, plain);
  others[0].optics.focal = 1.0;
  others[1].optics.pixelAspect = 1.5f;
  others[2].optics.clipNear = 1.0f;
  others[3].optics.clipFar = 1.0f;
  others[4].optics.panorama = true;
  others[5].optics.lensRadius = 1.0f;
  others[6].optics.lensRadius = others[6].optics.focus = 1.0f;
  for (size_t a = 0; a < others.size(); ++a) {
    EXPECT_NE(key(others[a]), key(plain)) << a;
    for (size_t b = 0; b < a; ++b) EXPECT_NE(key(others[a]), key(others[b])) << a << " " << b;
  }
}

}  // namespace
}  // namespace gobo::camera_test

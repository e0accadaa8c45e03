// SPDX-License-Identifier: Apache-2.0
// Oracles: the map convention of the design (top row +Y, u = 0.5 + atan2(z, x) / 2 pi), inverse maps, solid-angle integrals.
#include "scene/environment.h"

#include <gtest/gtest.h>

#include <limits>

#include "base/image_io.h"
#include "base/sobol.h"
#include "scene/environment_tents.h"

namespace gobo {
namespace {

TEST(Environment, FollowsTheConvention) {
  Environment e;
  EXPECT_NEAR(e.toUv(Vec3(1, 0, 0)).x, 0.5f, 1e-7);
  EXPECT_NEAR(e.toUv(Vec3(0, 0, 1)).x, 0.75f, 1e-7);
  EXPECT_NEAR(e.toUv(Vec3(0, 0, -1)).x, 0.25f, 1e-7);
  EXPECT_NEAR(e.toUv(Vec3(0, 1, 0)).y, 0.0f, 1e-7);
  EXPECT_NEAR(e.toUv(Vec3(1, 0, 0)).y, 0.5f, 1e-7);
  EXPECT_LT(e.toUv(Vec3(0, -1, 0)).y, 1.0f);
  EXPECT_LT(e.toUv(Vec3(-1, 0, -1e-30f)).x, 1.0f);
  // A quarter turn counter-clockwise seen from above takes what was at +X to -Z.
  e.rotation = 0.5f * kPi;
  EXPECT_NEAR(e.toUv(Vec3(0, 0, -1)).x, 0.5f, 1e-6);
}

TEST(Environment, UvAndDirectionAreInverse) {
  for (float rotation : {0.0f, 1.3f, -40.0f}) {
    Environment e;
    e.rotation = rotation;
    for (int i = 0; i < 20000; ++i) {
      const Vec2 uv(toUnit(hash32(1, i)), toUnit(hash32(2, i)));
      const Vec3 d = e.toDirection(uv);
      EXPECT_NEAR(glm::length(d), 1.0f, 1e-6f);
      EXPECT_LT(glm::length(e.toDirection(e.toUv(d)) - d), 2e-6f);
      const Vec2 back = e.toUv(d);
      ASSERT_GE(back.x, 0.0f);
      ASSERT_LT(back.x, 1.0f);
      EXPECT_NEAR(back.y, uv.y, 1e-6f);
      const float du = std::fabs(back.x - uv.x), s = std::sin(kPi * uv.y);
      EXPECT_LT(std::fmin(du, 1.0f - du) * s, 1e-6f);  // near a pole u means little
    }
  }
}

TEST(Environment, EvalIsBilinearBetweenTexelCentres) {
  Image image(8, 4, 3);
  for (size_t i = 0; i < image.data.size(); ++i) image.data[i] = float((i * 37) % 23);
  auto e = std::make_shared<Environment>(*makeEnvironment("map", image));
  for (float rotation : {0.0f, 2.0f}) {
    e->rotation = rotation;
    const auto at = [&](float x, float y) { return e->eval(e->toDirection(Vec2(x / 8, y / 4))); };
    const auto near = [](const Vec3& a, const Vec3& b) { return glm::length(a - b) < 1e-4f; };
    for (int y = 0; y < 4; ++y)
      for (int x = 0; x < 8; ++x) {
        EXPECT_TRUE(near(at(x + 0.5f, y + 0.5f), image.rgb(x, y)));
        const Vec3 right = image.rgb((x + 1) % 8, y);  // the seam is no edge
        const float across = x + 1.0f < 8 ? x + 1.0f : 0.0f;
        EXPECT_TRUE(near(at(across, y + 0.5f), 0.5f * (image.rgb(x, y) + right))) << x << " " << y;
        if (y < 3) { EXPECT_TRUE(near(at(x + 0.5f, y + 0.75f), 0.75f * image.rgb(x, y) + 0.25f * image.rgb(x, y + 1))); }
      }
    for (int x = 0; x < 8; ++x)  // constant from the outermost centres to the poles
      for (float a : {0.01f, 0.3f}) {
        EXPECT_TRUE(near(at(x + 0.5f, a), image.rgb(x, 0)));
        EXPECT_TRUE(near(at(x + 0.5f, 4 - a), image.rgb(x, 3)));
      }
  }
}

/// The kind: no look-up jumps. A step across directions 1e-4 apart is at most what the gradient allows, seams and texel edges included.
TEST(Environment, EvalIsContinuous) {
  Image image(16, 8, 3);
  for (size_t i = 0; i < image.data.size(); ++i) image.data[i] = float((i * 71) % 101) / 101;
  const auto e = makeEnvironment("map", image);
  for (int i = 0; i < 20000; ++i) {
    const float v = 0.1f + 0.8f * toUnit(hash32(1, i)), u = i % 4 ? toUnit(hash32(2, i)) : float(hash32(2, i) % 16) / 16;
    const Vec3 a = e->eval(e->toDirection(Vec2(u, v))), b = e->eval(e->toDirection(Vec2(u < 2e-5f ? u + 0.99998f : u - 2e-5f, v + (i % 3 - 1) * 2e-5f)));
    EXPECT_LT(glm::length(a - b), 2e-3f) << u << " " << v;  // 16 texels x 2e-5 x sqrt(3), and along v
  }
}

TEST(Environment, RepairsAndCountsBadTexels) {
  Image image(4, 2, 3);
  std::fill(image.data.begin(), image.data.end(), 1.0f);
  image.at(0, 0)[1] = std::numeric_limits<float>::quiet_NaN();
  image.at(2, 1)[2] = std::numeric_limits<float>::infinity();
  image.at(3, 1)[0] = -1.0f;
  const auto e = makeEnvironment("map", image);
  EXPECT_EQ(e->repairedTexels, 3);
  for (const Vec3& t : e->texels) EXPECT_TRUE(isFinite(t) && t.x >= 0 && t.y >= 0 && t.z >= 0);
  EXPECT_EQ(e->texels[0], Vec3(0.0f));
  EXPECT_EQ(e->texels[1], Vec3(1.0f));
}

/// IEC 61966-2-1: code value 0.5 is 0.2140 of white. Alpha is not radiance.
TEST(Environment, PngAndJpegAreCodeValuesAndExrIsRadiance) {
  for (const int channels : {1, 3, 4}) {
    Image image(16, 8, channels);
    for (float& v : image.data) v = 0.5f;
    PixelOptions codes;
    codes.data = true;
    codes.bits = 16;
    const auto png = *encodePng(image, codes);
    const auto map = readEnvironment(png.data(), png.size(), "a.hdr");  // whatever its name
    ASSERT_TRUE(map.ok()) << map.status().toString();
    for (const Vec3& texel : (*map)->texels)
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(texel[c], 0.2140f, 1e-4f) << channels;
    if (channels != 3) continue;
    codes.bits = 8;
    const auto coarse = *encodePng(image, codes), jpeg = *encodeJpeg(image, codes), exr = *encodeExr(image);
    EXPECT_NEAR((*readEnvironment(coarse.data(), coarse.size(), "a.png"))->texels[0].x, 0.2159f, 1e-4f);  // of 128 / 255
    EXPECT_NEAR((*readEnvironment(jpeg.data(), jpeg.size(), "a.jpg"))->texels[0].y, 0.2159f, 5e-3f);
    EXPECT_EQ((*readEnvironment(exr.data(), exr.size(), "a.exr"))->texels[0], Vec3(0.5f));
  }
}

TEST(Environment, ContentFollowsTexelsNotName) {
  EXPECT_EQ(constantEnvironment(Vec3(1.0f))->content, constantEnvironment(Vec3(1.0f))->content);
  EXPECT_NE(constantEnvironment(Vec3(1.0f))->content, constantEnvironment(Vec3(1.0f, 1.0f, 1.0001f))->content);
  EXPECT_EQ(constantEnvironment(Vec3(0.3f))->eval(glm::normalize(Vec3(1, -2, 3))), Vec3(0.3f));
}

// The sun's energy: (map with sun) - (map without) integrates to the same irradiance at any resolution, also where the disk
// (0.53 degrees) is far below a texel (32 wide: 11 degrees) and where it covers several (2048: 0.18 degrees).
TEST(Sky, SunEnergyDoesNotDependOnResolution) {
  SkyParameters with, without;
  with.groundAlbedo = without.groundAlbedo = Vec3(0.0f);
  without.sunScale = 0.0f;
  double first = 0.0;
  for (int width : {32, 256, 2048}) {
    const auto a = skyEnvironment(with, width), b = skyEnvironment(without, width);
    double energy = 0.0;
    const EnvironmentTents tents(a->width, a->height);
    for (int y = 0; y < a->height; ++y)
      for (int x = 0; x < a->width; ++x) {
        const size_t i = size_t(y) * a->width + x;
        energy += (double(a->texels[i].y) - double(b->texels[i].y)) * tents.weight(y);
      }
    // Closed form: 13.31 exp(-m (0.008735 0.55^-4.08 + beta 0.55^-1.3)), beta = 0.04608 * 3 - 0.04586, m the air mass.
    const double theta = std::acos(0.8 / std::sqrt(0.16 + 0.64 + 0.09)), degrees = theta * 180 / kPi;
    const double m = 1 / (std::cos(theta) + 0.15 * std::pow(93.885 - degrees, -1.253)), beta = 0.04608365822050 * 3 - 0.04586025928522;
    const double expected = 13.31 * std::exp(-m * (0.008735 * std::pow(0.55, -4.08) + beta * std::pow(0.55, -1.3)));
    EXPECT_NEAR(energy, expected, 2e-4 * expected) << width;
    if (first == 0.0) first = energy;
    EXPECT_NEAR(energy, first, 2e-4 * first);
  }
}

TEST(Sky, IsFiniteBrightAndBlueAtTheZenith) {
  for (float height : {-0.2f, 0.0f, 0.05f, 0.5f, 1.0f})
    for (float turbidity : {0.0f, 2.0f, 6.0f, 20.0f}) {
      SkyParameters p;
      p.sunDirection = Vec3(std::sqrt(1 - height * height), height, 0);
      p.turbidity = turbidity;
      const auto e = skyEnvironment(p, 64);
      EXPECT_EQ(e->repairedTexels, 0) << height << " " << turbidity;
      EXPECT_EQ(e->width, 64);
      EXPECT_EQ(e->height, 32);
    }
  SkyParameters p;
  p.sunScale = 0.0f;
  const Vec3 zenith = skyEnvironment(p, 256)->eval(Vec3(0, 1, 0));
  EXPECT_GT(zenith.z, zenith.x);
  EXPECT_GT(luminance(zenith), 0.3f);
  EXPECT_LT(luminance(zenith), 5.0f);
}

}  // namespace
}  // namespace gobo

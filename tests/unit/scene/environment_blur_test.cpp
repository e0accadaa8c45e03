// SPDX-License-Identifier: Apache-2.0
// The blurred environment: constants stay, a small bright spot becomes a Gaussian of its angle, light is neither lost nor made.
#include <gtest/gtest.h>

#include "scene/environment_blur.h"
#include "scene/environment_tents.h"

namespace gobo::environment_blur_test {
namespace {

constexpr double kDegree = M_PI / 180.0;

TEST(EnvironmentBlur, AConstantStays) {
  const EnvironmentPtr map = constantEnvironment(Vec3(0.25f, 2.0f, 3e38f));
  for (const double sigma : {0.5, 3.0, 20.0, 90.0}) {
    const EnvironmentPtr blurred = blurredEnvironment(*map, sigma * kDegree);
    ASSERT_TRUE(blurred);
    for (const Vec3& t : blurred->texels) {
      ASSERT_NEAR(t.x, 0.25f, 1e-4f * 0.25f) << sigma;
      ASSERT_NEAR(t.y, 2.0f, 1e-4f * 2.0f) << sigma;
      ASSERT_NEAR(t.z / 3e38f, 1.0f, 1e-4f) << sigma;
    }
    if (sigma < 1.0) break;  // the others are quick
  }
}

TEST(EnvironmentBlur, ASpotBecomesAGaussianOfItsAngle) {
  const int W = 720, H = 360;
  for (const int row : {20, 120, 179}) {  // near a pole, in between, at the horizon
    Image image(W, H, 3);
    for (int c = 0; c < 3; ++c) image.at(200, row)[c] = 1e6f;
    const EnvironmentPtr map = makeEnvironment("spot", std::move(image));
    const Vec3 spot = map->toDirection(Vec2((200.5f) / W, (float(row) + 0.5f) / H));
    for (const double sigma : {4.0, 15.0}) {
      const EnvironmentPtr blurred = blurredEnvironment(*map, sigma * kDegree);
      const double peak = blurred->eval(spot).x;
      ASSERT_GT(peak, 0.0);
      // Against exp(-a^2 / 2 s^2) times the spot's share of the kernel; away from it along a meridian, to either side.
      const double theta = M_PI * (row + 0.5) / H;
      for (double angle = 0.0; angle <= 2.5 * sigma; angle += 0.5 * sigma)
        for (const double sign : {-1.0, 1.0}) {
          const double at = theta + sign * angle * kDegree;
          if (at < 0.01 || at > M_PI - 0.01) continue;
          const double value = blurred->eval(map->toDirection(Vec2(200.5f / W, float(at / M_PI)))).x;
          EXPECT_NEAR(value / peak, std::exp(-0.5 * angle * angle / (sigma * sigma)), 0.025) << row << " sigma " << sigma << " at " << sign * angle;
        }
      // The sphere's Gaussian has no closed norm; that of the plane is within a share of sigma^2 / 6.
      const double solid = (std::cos(M_PI * row / H) - std::cos(M_PI * (row + 1) / H)) * 2.0 * M_PI / W, s = sigma * kDegree;
      EXPECT_NEAR(peak, 1e6 * solid / (2.0 * M_PI * s * s), 0.06 * peak) << row << " sigma " << sigma;
      EXPECT_NEAR(environmentFlux(blurred.get()), environmentFlux(map.get()), 0.05 * environmentFlux(map.get())) << row << " sigma " << sigma;
    }
  }
}

TEST(EnvironmentBlur, KeepsTheRotationAndIsTheSameEachTime) {
  auto map = std::make_shared<Environment>(*skyEnvironment({}, 128));
  const EnvironmentPtr a = blurredEnvironment(*map, 0.3);
  map->rotation = 1.25f;
  const EnvironmentPtr b = blurredEnvironment(*map, 0.3);
  EXPECT_EQ(b->rotation, 1.25f);
  EXPECT_EQ(a->rotation, 0.0f);
  EXPECT_EQ(a->content, b->content);
  for (const double other : {0.31, 0.32, 0.33, 0.34, 0.35}) EXPECT_NE(blurredEnvironment(*map, other)->content, a->content);
  EXPECT_EQ(blurredEnvironment(*map, 0.3)->content, a->content);  // made again: the kept ones have gone
}

}  // namespace
}  // namespace gobo::environment_blur_test

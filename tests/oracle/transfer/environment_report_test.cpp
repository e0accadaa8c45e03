// SPDX-License-Identifier: Apache-2.0
// What `gobo environment` says of a map, against closed forms.
#include "techniques/transfer/environment_report.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

namespace gobo::transfer::environment_report_test {
namespace {

EnvironmentPtr mapOf(int width, const std::function<double(const DVec3&)>& radiance) {
  Image image(width, width / 2, 3);
  for (int y = 0; y < width / 2; ++y)
    for (int x = 0; x < width; ++x) {
      const double theta = (y + 0.5) * std::numbers::pi / (width / 2), phi = (x + 0.5) * 2 * std::numbers::pi / width - std::numbers::pi;
      const double v = radiance(DVec3(std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi)));
      for (size_t c = 0; c < 3; ++c) image.data[3 * size_t(y * width + x) + c] = float(v);
    }
  return makeEnvironment("map", std::move(image));
}

TEST(EnvironmentReport, OfAConstantMapMissesNothing) {
  const EnvironmentReport r = reportEnvironment(*constantEnvironment(Vec3(2.0f)), 3, 16, 0.02, TaskArena(2));
  EXPECT_LT(r.whole.error, 1e-5);
  EXPECT_LT(r.rest.error, 1e-5);
  EXPECT_NEAR(r.whole.least, 2.0, 1e-4);
  EXPECT_TRUE(r.split.lights.empty());
  EXPECT_EQ(r.lightShare, 0.0);
  const EnvironmentReport black = reportEnvironment(*constantEnvironment(Vec3(0.0f)), 3, 16, 0.02, TaskArena(2));
  EXPECT_EQ(black.whole.error, 0.0);
  EXPECT_EQ(black.lightShare, 0.0);
}

// f = 1 + y / 2 + 3 x z / 10: the square's integral is 4 pi (1 + 1 / 12 + 9 / 1500), and xz is of the third band.
TEST(EnvironmentReport, OfThreeBandsMissesWhatTheThirdHolds) {
  const EnvironmentPtr map = mapOf(1024, [](const DVec3& d) { return 1 + 0.5 * d.y + 0.3 * d.x * d.z; });
  const double third = 9.0 / 1500, all = 1 + 1.0 / 12 + third;
  EXPECT_NEAR(reportEnvironment(*map, 2, 0, 0.02, TaskArena(2)).whole.error, std::sqrt(third / all), 1e-4);
  const EnvironmentReport three = reportEnvironment(*map, 3, 0, 0.02, TaskArena(2));
  EXPECT_LT(three.whole.error, 1e-4);
  double least = 1;
  for (double y = -1; y <= 1; y += 1e-3) least = std::min(least, 1 + 0.5 * y - 0.15 * (1 - y * y));  // where x z is -(1 - y^2) / 2
  EXPECT_NEAR(three.whole.least, least, 2e-3);
}

// A sun of 1 degree that has a third of the light of a dim sky's two thirds.
TEST(EnvironmentReport, ASunIsALightAndLeavesWhatHarmonicsHold) {
  const DVec3 sun = glm::normalize(DVec3(0.3, 0.8, -0.5));
  const double disk = 2 * std::numbers::pi * (1 - std::cos(0.5 * std::numbers::pi / 180));
  const EnvironmentPtr map = mapOf(2048, [&](const DVec3& d) {
    const double angle = std::acos(std::min(glm::dot(d, sun), 1.0)) * 180 / std::numbers::pi;
    return 1 + 0.4 * d.y + (angle < 0.5 ? 2 * std::numbers::pi / disk : 0.0);
  });
  const EnvironmentReport r = reportEnvironment(*map, 4, 16, 0.02, TaskArena(2));
  ASSERT_EQ(r.split.lights.size(), 1u);
  EXPECT_NEAR(r.lightShare, 1.0 / 3, 0.01);  // of a disk cut out in texels
  EXPECT_GT(r.whole.error, 0.9);             // few harmonics have no peak
  EXPECT_LT(r.rest.error, 0.1);
  EXPECT_LT(r.whole.least, 0.0);
  EXPECT_GT(r.rest.least, 0.4);
  const EnvironmentReport none = reportEnvironment(*map, 4, 0, 0.02, TaskArena(2));
  EXPECT_EQ(none.lightShare, 0.0);
  EXPECT_EQ(none.rest.error, none.whole.error);
  StopSource stopped;
  stopped.stop(StopReason::Cancelled);
  EXPECT_TRUE(reportEnvironment(*map, 4, 0, 0.02, TaskArena(2), stopped.token()).split.full.empty());
}

}  // namespace
}  // namespace gobo::transfer::environment_report_test

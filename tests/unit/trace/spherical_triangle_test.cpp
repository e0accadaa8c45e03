// SPDX-License-Identifier: Apache-2.0
// Oracles: the solid angle of van Oosterom & Strackee 1983, and means of directions over the flat triangle weighted by cos / d^2.
#include "trace/spherical_triangle.h"

#include <gtest/gtest.h>

#include "support/chi2.h"

namespace gobo::spherical_triangle_test {
namespace {

using test::Rng;

struct Case {
  Vec3 p, v, e1, e2;
};

std::vector<Case> cases() {
  std::vector<Case> out = {{Vec3(0.3f, 0.02f, 0.3f), Vec3(0), Vec3(1, 0, 0), Vec3(0, 0, 1)},         // close above the middle: nearly 2 pi
                           {Vec3(0.001f, 0.0001f, 0.001f), Vec3(0), Vec3(1, 0, 0), Vec3(0, 0, 1)},   // close to a corner
                           {Vec3(1.2f, 0.01f, 0.3f), Vec3(0), Vec3(1, 0, 0), Vec3(0, 0, 1)},         // beside it, near its plane
                           {Vec3(0, 3, 0), Vec3(-5, 0, 0), Vec3(10, 0, 0.01f), Vec3(5, 0, 0.02f)}};  // a sliver
  Rng rng(5);
  const auto point = [&](float scale) { return Vec3(rng.next() - 0.5f, rng.next() - 0.5f, rng.next() - 0.5f) * scale; };
  for (int k = 0; k < 40; ++k) out.push_back({point(2), point(2), point(2), point(2)});
  return out;
}

double oosterom(const Case& c) {
  const DVec3 a = glm::normalize(DVec3(c.v) - DVec3(c.p)), b = glm::normalize(DVec3(c.v) + DVec3(c.e1) - DVec3(c.p)),
              d = glm::normalize(DVec3(c.v) + DVec3(c.e2) - DVec3(c.p));
  return 2 * std::fabs(std::atan2(glm::dot(a, glm::cross(b, d)), 1 + glm::dot(a, b) + glm::dot(b, d) + glm::dot(d, a)));
}

TEST(SphericalTriangle, SolidAngleIsOosteroms) {
  for (const Case& c : cases()) {
    const SphericalTriangle t(c.p, c.v, c.e1, c.e2);
    if (oosterom(c) < 2e-6) continue;
    ASSERT_TRUE(t.valid());
    EXPECT_NEAR(t.solidAngle(), oosterom(c), 1e-9 + 1e-9 * oosterom(c));
    EXPECT_NEAR(t.area(), 0.5 * glm::length(glm::cross(DVec3(c.e1), DVec3(c.e2))), 1e-12);
  }
}

/// Shares of the solid angle of the triangle's four quarters: of the samples by barycentrics, against Oosterom's of each quarter.
TEST(SphericalTriangle, QuartersGetTheirShare) {
  for (const Case& c : cases()) {
    const SphericalTriangle t(c.p, c.v, c.e1, c.e2);
    if (!t.valid()) continue;
    const int n = 1 << 14;
    double count[4] = {};
    for (int k = 0; k < n; ++k) {
      Vec2 b;
      const DVec3 d = t.sample((k + 0.5) / n, toUnit(hash32(77, uint64_t(k))), b);
      ASSERT_TRUE(b.x >= 0 && b.y >= 0 && b.x + b.y <= 1.0f + 1e-6f);
      const DVec3 flat = DVec3(c.v) + DVec3(c.e1) * double(b.x) + DVec3(c.e2) * double(b.y) - DVec3(c.p);
      ASSERT_LT(glm::length(d - flat), 1e-6 * (1 + glm::length(d)));
      ++count[b.x > 0.5f ? 1 : b.y > 0.5f ? 2 : b.x + b.y < 0.5f ? 0 : 3];
    }
    const Vec3 h1 = c.e1 * 0.5f, h2 = c.e2 * 0.5f;
    const Case quarters[4] = {{c.p, c.v, h1, h2}, {c.p, c.v + h1, h1, h2}, {c.p, c.v + h2, h1, h2}, {c.p, c.v + h1 + h2, -h1, -h2}};
    for (int q = 0; q < 4; ++q) {
      const double share = oosterom(quarters[q]) / oosterom(c);
      EXPECT_NEAR(count[q] / n, share, 4.5 * std::sqrt(std::max(share * (1 - share), 1e-9) / n) + 1e-4) << "quarter " << q << " of " << oosterom(c) << " sr";
    }
  }
}

}  // namespace
}  // namespace gobo::spherical_triangle_test

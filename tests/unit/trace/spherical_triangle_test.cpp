// SPDX-License-Identifier: Apache-2.0
// Oracle: solid angles by Girard's excess of the three angles, in long double.
#include "trace/spherical_triangle.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

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

/// Between the planes through `at` and the other two.
long double angleAt(const glm::tvec3<long double>& at, const glm::tvec3<long double>& b, const glm::tvec3<long double>& c) {
  const auto u = glm::normalize(glm::cross(at, b)), v = glm::normalize(glm::cross(at, c));
  return 2 * std::atan2(glm::length(u - v), glm::length(u + v));
}
double excess(const Case& c) {
  using Long = glm::tvec3<long double>;
  const Long a = Long(c.v) - Long(c.p), b = a + Long(c.e1), d = a + Long(c.e2);
  return double(angleAt(a, b, d) + angleAt(b, d, a) + angleAt(d, a, b) - std::numbers::pi_v<long double>);
}

TEST(SphericalTriangle, SolidAngleIsTheExcessOfItsAngles) {
  for (const Case& c : cases()) {
    const SphericalTriangle t(c.p, c.v, c.e1, c.e2);
    if (excess(c) < 2e-6) continue;
    ASSERT_TRUE(t.valid());
    EXPECT_NEAR(t.solidAngle(), excess(c), 1e-9 + 1e-9 * excess(c));
    EXPECT_NEAR(t.area(), 0.5 * glm::length(glm::cross(DVec3(c.e1), DVec3(c.e2))), 1e-12);
  }
}

/// Shares of the solid angle of the triangle's four quarters: of the samples by barycentrics, against that of each quarter.
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
      const double share = excess(quarters[q]) / excess(c);
      EXPECT_NEAR(count[q] / n, share, 4.5 * std::sqrt(std::max(share * (1 - share), 1e-9) / n) + 1e-4) << "quarter " << q << " of " << excess(c) << " sr";
    }
  }
}

}  // namespace
}  // namespace gobo::spherical_triangle_test

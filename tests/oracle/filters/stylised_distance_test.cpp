// SPDX-License-Identifier: Apache-2.0
// L_p-averaged distance against closed forms: segments, infinite lines, circles, and the limits of p.
#include <gtest/gtest.h>

#include <cmath>

#include "filters/stylised/averaged_distance.h"

namespace gobo {
namespace {

constexpr float kAnyNormal = -2.0f;  // cosine: no guard

std::vector<ContourSegment> polyline(const std::vector<DVec3>& points, bool closed) {
  std::vector<ContourSegment> out;
  for (size_t k = 0; k + (closed ? 0 : 1) < points.size(); ++k) out.push_back({Vec3(points[k]), Vec3(points[(k + 1) % points.size()]), Vec3(0, 0, 1)});
  return out;
}
std::vector<ContourSegment> circle(double radius, int sides = 4096) {
  std::vector<DVec3> points;
  for (int k = 0; k < sides; ++k) points.push_back(radius * DVec3(std::cos(2 * M_PI * k / sides), std::sin(2 * M_PI * k / sides), 0));
  return polyline(points, true);
}
double distanceTo(const std::vector<ContourSegment>& contour, const Vec3& x, int p, StyleNorm norm) {
  return averagedDistanceTo(contour, x, Vec3(0, 0, 1), p, norm, kAnyNormal);
}

/// Antiderivative of (h^2 + t^2)^(-p/2) for even p, by the recurrence of integration by parts.
double antiderivative(double t, double h, int p) {
  double value = std::atan(t / h) / h;
  for (int n = 2; n < p; n += 2) value = t / (n * h * h * std::pow(h * h + t * t, 0.5 * n)) + (n - 1.0) / (n * h * h) * value;
  return value;
}

TEST(AveragedDistance, IntegralOverASegmentIsTheClosedForm) {
  for (const int p : {2, 4, 8, 16})
    for (const double h : {0.05, 0.3, 1.0, 4.0})
      for (const double from : {-3.0, -0.5, 0.2, 2.0}) {
        const double to = from + 1.7, exact = antiderivative(to, h, p) - antiderivative(from, h, p);
        // What the closed form itself loses: powers of 1/h cancel where the segment is not at the point's foot.
        const double lost = 1e-14 * std::max(std::abs(antiderivative(to, h, p)), std::abs(antiderivative(from, h, p)));
        const double got = inversePowerIntegral(DVec3(0.0), DVec3(from, h, 0), DVec3(to, h, 0), p, 1.0);
        EXPECT_NEAR(got, exact, 1e-8 * got + lost) << p << " " << h << " " << from;
      }
}

TEST(AveragedDistance, IntegralOnTheSegmentsOwnLineIsTheClosedForm) {
  for (const int p : {2, 3, 8, 33})
    for (const double from : {0.01, 0.5, 7.0}) {
      const double to = from + 1.0, exact = (std::pow(from, 1 - p) - std::pow(to, 1 - p)) / (p - 1);
      EXPECT_NEAR(inversePowerIntegral(DVec3(0.0), DVec3(from, 0, 0), DVec3(to, 0, 0), p, 1.0), exact, 1e-8 * exact) << p << " " << from;
      EXPECT_NEAR(inversePowerIntegral(DVec3(0.0), DVec3(-to, 0, 0), DVec3(-from, 0, 0), p, 1.0), exact, 1e-8 * exact) << p << " " << from;
    }
}

TEST(AveragedDistance, OddPowersOfAStraightLine) {  // p = 3: t / (h^2 sqrt(h^2 + t^2))
  for (const double h : {0.2, 1.0, 3.0}) {
    const auto f = [&](double t) { return t / (h * h * std::sqrt(h * h + t * t)); };
    const double exact = f(5) - f(-2);
    EXPECT_NEAR(inversePowerIntegral(DVec3(0.0), DVec3(-2, 0, h), DVec3(5, 0, h), 3, 1.0), exact, 1e-8 * exact);
  }
}

TEST(AveragedDistance, ConstantOfTheInfiniteLine) {
  EXPECT_NEAR(straightLineConstant(2), M_PI, 1e-12);
  EXPECT_NEAR(straightLineConstant(3), 2, 1e-12);
  EXPECT_NEAR(straightLineConstant(8), 5 * M_PI / 16, 1e-12);
  EXPECT_NEAR(straightLineConstant(16), 0.6581, 1e-4);
}

TEST(AveragedDistance, LocalNormIsTheDistanceOfAStraightEdge) {
  const auto line = polyline({{-1000, 0, 0}, {1000, 0, 0}}, false);
  for (const float d : {0.01f, 1.0f, 20.0f}) {
    EXPECT_NEAR(distanceTo(line, Vec3(0, d, 0), 8, StyleNorm::Local), double(d), 1e-6 * double(d));
    EXPECT_NEAR(distanceTo(line, Vec3(3, 0, d), 64, StyleNorm::Local), double(d), 1e-6 * double(d));
  }
  EXPECT_NEAR(distanceTo(line, Vec3(0, 1, 0), 2, StyleNorm::Local), 1, 1e-3);  // ends at 1000 are seen: 1/(1 - 2/(1000 pi))
}

TEST(AveragedDistance, PublishedNormGrowsWithTheContour) {
  for (const double length : {1000.0, 2000.0, 4000.0}) {
    const auto line = polyline({{-0.5 * length, 0, 0}, {0.5 * length, 0, 0}}, false);
    const double expected = std::pow(length / straightLineConstant(8), 0.125) * std::pow(20.0, 0.875);
    EXPECT_NEAR(distanceTo(line, Vec3(0, 20, 0), 8, StyleNorm::Published), expected, 1e-5 * expected);
  }
  EXPECT_NEAR(distanceTo(polyline({{-1000, 0, 0}, {1000, 0, 0}}, false), Vec3(0, 20, 0), 8, StyleNorm::Published), 35.6, 0.05);
}

TEST(AveragedDistance, CirclesOfEvenPowers) {
  // |R^2 - r^2|^(2m-1) / sum C(m-1,k)^2 R^(2(m-1-k)) r^(2k), to 1/(2m)
  const auto contour = circle(2);
  EXPECT_NEAR(distanceTo(contour, Vec3(1, 0, 0), 8, StyleNorm::Published), 1.31473, 2e-5);
  EXPECT_NEAR(distanceTo(contour, Vec3(0, 3, 0), 8, StyleNorm::Published), 1.40985, 2e-5);
  EXPECT_NEAR(distanceTo(contour, Vec3(-1.9f, 0, 0), 8, StyleNorm::Published), 0.18281, 2e-5);
  for (const int p : {2, 3, 8, 17, 64}) EXPECT_NEAR(distanceTo(contour, Vec3(0.0f), p, StyleNorm::Published), 2, 1e-5) << p;
  for (const double r : {0.5, 1.5, 2.5, 10.0})
    for (const int m : {1, 2, 4, 6}) {
      double sum = 0, binomial = 1;
      for (int k = 0; k < m; ++k) {
        sum += binomial * binomial * std::pow(2.0, 2 * (m - 1 - k)) * std::pow(r, 2 * k);
        binomial = binomial * (m - 1 - k) / (k + 1);
      }
      const double expected = std::pow(std::pow(std::abs(4 - r * r), 2 * m - 1) / sum, 0.5 / m);
      EXPECT_NEAR(distanceTo(contour, Vec3(float(r), 0, 0), 2 * m, StyleNorm::Published), expected, 1e-4 * expected) << r << " " << m;
    }
}

TEST(AveragedDistance, FarAwayBothAreTheDistanceOrItsPower) {  // the contour is a point of its length there
  const auto contour = circle(1);
  const double L = 2 * M_PI, far = 1e4;
  EXPECT_NEAR(distanceTo(contour, Vec3(1e4f, 0, 0), 8, StyleNorm::Published), far, 1e-4 * far);
  const double local = std::pow(L / straightLineConstant(8) * std::pow(far, -8), -1.0 / 7);
  EXPECT_NEAR(distanceTo(contour, Vec3(0, 1e4f, 0), 8, StyleNorm::Local), local, 1e-4 * local);
}

TEST(AveragedDistance, PowerMeansLieBetweenTheExtremesAndFallTowardsTheNearest) {
  const auto contour = polyline({{0, 0, 0}, {3, 0, 0}, {3, 1, 1}, {0, 4, 0}}, true);
  for (const Vec3 x : {Vec3(1, 1, 0), Vec3(-2, 3, 1), Vec3(2.9f, 0.1f, 0)}) {
    double nearest2 = HUGE_VAL, farthest = 0;
    for (const ContourSegment& s : contour) {
      nearest2 = std::min(nearest2, squaredDistanceToSegment(DVec3(x), DVec3(s.a), DVec3(s.b)));
      farthest = std::max(farthest, double(glm::length(x - s.a)));
    }
    double last = farthest;
    for (int p = 2; p <= 64; ++p) {
      const double d = distanceTo(contour, x, p, StyleNorm::Published);
      EXPECT_LT(d, last) << p;
      EXPECT_GE(d, std::sqrt(nearest2)) << p;
      last = d;
    }
    EXPECT_NEAR(distanceTo(contour, x, 64, StyleNorm::Local), std::sqrt(nearest2), 0.03 * std::sqrt(nearest2));
  }
}

TEST(AveragedDistance, ScalesWithTheWorld) {
  for (const StyleNorm norm : {StyleNorm::Local, StyleNorm::Published})
    for (const int p : {2, 8, 64}) {
      const double one = distanceTo(circle(2, 256), Vec3(0.3f, 0.7f, 0), p, norm);
      for (const float scale : {1e-4f, 1e-2f, 1e3f, 1e6f})
        EXPECT_NEAR(distanceTo(circle(2 * double(scale), 256), scale * Vec3(0.3f, 0.7f, 0), p, norm), one * double(scale), 1e-4 * one * double(scale))
            << p << " " << scale;
    }
}

TEST(AveragedDistance, GuardLeavesOutWhatIsTurnedAway) {
  auto two = polyline({{-50, 1, 0}, {50, 1, 0}}, false);
  two.push_back({Vec3(-50, -3, 0), Vec3(50, -3, 0), Vec3(0, 1, 0)});
  const float cosine = std::cos(0.785f);
  EXPECT_NEAR(averagedDistanceTo(two, Vec3(0.0f), Vec3(0, 0, 1), 8, StyleNorm::Local, cosine), 1, 1e-5);
  EXPECT_NEAR(averagedDistanceTo(two, Vec3(0.0f), Vec3(0, 1, 0), 8, StyleNorm::Local, cosine), 3, 1e-5);
  EXPECT_EQ(averagedDistanceTo(two, Vec3(0.0f), Vec3(1, 0, 0), 8, StyleNorm::Local, cosine), double(kStyleFar));
  EXPECT_EQ(averagedDistanceTo({}, Vec3(0.0f), Vec3(1, 0, 0), 8, StyleNorm::Local, cosine), double(kStyleFar));
  EXPECT_EQ(averagedDistanceTo(two, Vec3(2, 1, 0), Vec3(0, 0, 1), 8, StyleNorm::Local, cosine), 0);
}

}  // namespace
}  // namespace gobo

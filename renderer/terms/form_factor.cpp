// SPDX-License-Identifier: Apache-2.0
// Closed forms of irradiance: rectangle (Lambert's polygon formula) and ball, both clipped by the horizon, and disk. In double: the sum of
// edge terms cancels for far lights.
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <span>

#include "terms/direct_unoccluded.h"

namespace gobo {
inline namespace terms {

namespace {

/// Of a polygon with at most four corners, from the receiver.
double polygonFormFactor(std::span<const DVec3> corners, const DVec3& n) {
  // Clip to the half space above the receiver (Sutherland-Hodgman against one plane: at most five vertices).
  std::array<DVec3, 6> poly;
  int count = 0;
  for (size_t i = 0; i < corners.size(); ++i) {
    const DVec3 &a = corners[i], &b = corners[(i + 1) % corners.size()];
    const double da = glm::dot(a, n), db = glm::dot(b, n);
    if (da >= 0) poly[count++] = a;
    if ((da < 0) != (db < 0)) poly[count++] = a + (b - a) * (da / (da - db));
  }
  if (count < 3) return 0;
  double sum = 0;
  for (int i = 0; i < count; ++i) {
    const double la = glm::length(poly[i]), lb = glm::length(poly[(i + 1) % count]);
    if (!(la > 0) || !(lb > 0)) continue;  // the receiver touches a corner
    const DVec3 a = poly[i] / la, b = poly[(i + 1) % count] / lb;
    const DVec3 c = glm::cross(a, b);
    const double s = glm::length(c);
    if (!(s > 1e-300)) continue;
    sum += std::atan2(s, glm::dot(a, b)) * glm::dot(c, n) / s;
  }
  return std::fabs(sum) / (2.0 * 3.14159265358979323846);
}

}  // namespace

double rectFormFactor(const DVec3& p, const DVec3& n, const DVec3& corner, const DVec3& u, const DVec3& v) {
  const std::array<DVec3, 4> quad{corner - p, corner + u - p, corner + u + v - p, corner + v - p};
  return polygonFormFactor(quad, n);
}

double triangleFormFactor(const DVec3 (&corners)[3], const DVec3& n) { return polygonFormFactor(corners, n); }

double diskFormFactor(const DVec3& p, const DVec3& n, const DVec3& centre, const DVec3& axis, double radius) {
  const DVec3 d = centre - p;
  const double h = -glm::dot(d, axis), r2 = radius * radius;
  if (!(h > 0)) return 0.0;
  const DVec3 aside = d + h * axis;
  const double a2 = glm::dot(aside, aside), a = std::sqrt(a2), z = h * h + a2 + r2, root = std::sqrt(std::max(z * z - 4.0 * a2 * r2, 1e-300));
  const double along = 0.5 * (1.0 - (h * h + a2 - r2) / root);
  const double across = a > 1e-9 * h ? 0.5 * h / a * (z / root - 1.0) : 0.0;
  return std::max(-glm::dot(n, axis) * along + (a > 0 ? glm::dot(n, aside) / a : 0.0) * across, 0.0);
}

double capFormFactor(double cosine, double sine) {
  if (cosine <= -sine) return 0.0;
  if (cosine >= sine) return cosine * sine * sine;
  // Partly below the horizon: the integral of the cosine between the rim and the horizon (as Snyder 1996, "Area light sources for real-time graphics").
  const double up = std::sqrt(std::max(1.0 - cosine * cosine, 0.0)), x = std::sqrt(std::max(1.0 - sine * sine, 0.0)) / sine;
  const double y = up > 0 ? std::clamp(-x * cosine / up, -1.0, 1.0) : 0.0, rim = up * std::sqrt(1.0 - y * y);
  const double e = (cosine * std::acos(y) - x * rim) * sine * sine + (x > 0 ? std::atan(rim / x) : 0.5 * std::numbers::pi);
  return std::clamp(e / std::numbers::pi, 0.0, sine * sine);
}

double sphereFormFactor(const DVec3& p, const DVec3& n, const DVec3& centre, double radius) {
  const DVec3 d = centre - p;
  const double distance = glm::length(d);
  return distance > radius ? capFormFactor(glm::dot(d, n) / distance, radius / distance) : -1.0;
}

}  // namespace terms
}  // namespace gobo

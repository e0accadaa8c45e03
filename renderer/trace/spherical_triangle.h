// SPDX-License-Identifier: Apache-2.0
// A triangle as a near receiver sees it, sampled uniformly in solid angle (Arvo 1995, "Stratified sampling of spherical triangles"; the solid
// angle by Van Oosterom and Strackee 1983: one arc tangent where the sum of its angles takes three). From afar sampling by area is as good and
// cheaper; near by, its weights d^2 / cos vary over the triangle by orders of magnitude: on the ceiling beside a Cornell box's lamp it had
// twice the squared error. In double: angles are differences.
#pragma once

#include "base/vec.h"

namespace gobo {
inline namespace trace {

/// Is the triangle near enough for its solid angle to be asked? |p - centre|^2 < 8 areas: from about 0.12 sr on, seen straight.
/// A property of (triangle, p) alone: whoever samples and whoever asks for a density decide alike.
inline bool nearTriangle(const Vec3& p, const Vec3& v, const Vec3& e1, const Vec3& e2) {
  const Vec3 toCentre = v + (e1 + e2) * (1.0f / 3.0f) - p, n = glm::cross(e1, e2);
  const float d2 = glm::dot(toCentre, toCentre);
  return d2 * d2 < 16.0f * glm::dot(n, n);
}

class SphericalTriangle {
 public:
  /// Of v, v + e1, v + e2 around p.
  SphericalTriangle(const Vec3& p, const Vec3& v, const Vec3& e1, const Vec3& e2);
  /// False where there is no angle to speak of: p on an edge, in the plane within rounding, or below 1e-6 sr. Then by area.
  bool valid() const { return solidAngle_ > 1e-6; }
  double solidAngle() const { return solidAngle_; }  ///< sr
  double area() const { return area_; }              ///< of the flat one, m^2
  /// Way from p to a point of the triangle, uniform over directions, and the point's barycentrics along e1 and e2. O(1).
  DVec3 sample(double u, double v, Vec2& barycentrics) const;

 private:
  DVec3 corner_, e1_, e2_, normal_;  // flat triangle, from p; normal_ = e1 x e2
  DVec3 a_, b_, c_;                  // directions of its corners
  double solidAngle_ = 0, area_ = 0, cosAlpha_ = 0, sinAlpha_ = 0;
};

}  // namespace trace
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "trace/spherical_triangle.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace gobo {
inline namespace trace {
namespace {

/// Height above the triangle's plane, over distances and coordinates, from which on it is more than rounding.
constexpr double kPlane = 1e-5;

/// Between unit vectors; exact for small angles and near pi.
double angleBetween(const DVec3& a, const DVec3& b) { return 2.0 * std::atan2(glm::length(a - b), glm::length(a + b)); }

/// What of x is perpendicular to the unit vector w, of length 1; any perpendicular where nothing is.
DVec3 perpendicular(const DVec3& x, const DVec3& w) {
  const DVec3 r = x - w * glm::dot(x, w);
  const double l = glm::length(r);
  return l > 0 ? r / l : DVec3(0.0);
}

}  // namespace

SphericalTriangle::SphericalTriangle(const Vec3& p, const Vec3& v, const Vec3& e1, const Vec3& e2)
    : corner_(DVec3(v) - DVec3(p)), e1_(e1), e2_(e2), normal_(glm::cross(e1_, e2_)) {
  area_ = 0.5 * glm::length(normal_);
  const DVec3 corners[3] = {corner_, corner_ + e1_, corner_ + e2_};
  const double la = glm::length(corners[0]), lb = glm::length(corners[1]), lc = glm::length(corners[2]);
  const double longest = std::max({la, lb, lc});
  if (!(std::min({la, lb, lc}) > 1e-9 * longest)) return;
  a_ = corners[0] / la;
  b_ = corners[1] / lb;
  c_ = corners[2] / lc;
  const DVec3 ab = glm::cross(a_, b_), bc = glm::cross(b_, c_), ca = glm::cross(c_, a_);
  const double lab = glm::length(ab), lbc = glm::length(bc), lca = glm::length(ca);
  if (!(std::min({lab, lbc, lca}) > 1e-9)) return;
  // In the triangle's plane as far as a float position can tell: a lamp's own points would see half a sphere of it, on either side.
  const double rounding = kPlane * (longest + std::max({std::fabs(double(p.x)), std::fabs(double(p.y)), std::fabs(double(p.z))}));
  if (!(std::fabs(glm::dot(corner_, normal_)) > rounding * 2.0 * area_)) return;
  const double alpha = angleBetween(ab / lab, -ca / lca), beta = angleBetween(bc / lbc, -ab / lab), gamma = angleBetween(ca / lca, -bc / lbc);
  angles_ = alpha + beta + gamma;
  cosAlpha_ = std::cos(alpha);
  sinAlpha_ = std::sin(alpha);
  if (!(sinAlpha_ > 1e-9)) return;
  solidAngle_ = angles_ - std::numbers::pi;
}

DVec3 SphericalTriangle::sample(double u, double v, Vec2& barycentrics) const {
  // The corner c' for which the triangle a b c' has the share u of the solid angle; then a place on the arc from b to c'.
  const double share = std::numbers::pi + u * (angles_ - std::numbers::pi), sinShare = std::sin(share), cosShare = std::cos(share);
  const double sinPhi = sinShare * cosAlpha_ - cosShare * sinAlpha_, cosPhi = cosShare * cosAlpha_ + sinShare * sinAlpha_;
  const double k1 = cosPhi + cosAlpha_, k2 = sinPhi - sinAlpha_ * glm::dot(a_, b_);
  const double above = k2 + (k2 * cosPhi - k1 * sinPhi) * cosAlpha_, below = (k2 * sinPhi + k1 * cosPhi) * sinAlpha_;
  const double cosB = below != 0 ? std::clamp(above / below, -1.0, 1.0) : 1.0, sinB = std::sqrt(std::max(1.0 - cosB * cosB, 0.0));
  const DVec3 end = cosB * a_ + sinB * perpendicular(c_, a_);
  const double z = 1.0 - v * (1.0 - glm::dot(end, b_));
  const DVec3 w = z * b_ + std::sqrt(std::max(1.0 - z * z, 0.0)) * perpendicular(end, b_);
  // Where it meets the plane; rounding may leave the triangle by a hair, and is put back.
  const double along = glm::dot(w, normal_), n2 = glm::dot(normal_, normal_);
  const DVec3 place = along != 0 ? w * (glm::dot(corner_, normal_) / along) - corner_ : DVec3(0.0);
  double x = std::clamp(glm::dot(glm::cross(place, e2_), normal_) / n2, 0.0, 1.0), y = std::clamp(glm::dot(glm::cross(e1_, place), normal_) / n2, 0.0, 1.0);
  if (x + y > 1.0) {
    const double s = 1.0 / (x + y);
    x *= s;
    y *= s;
  }
  barycentrics = Vec2(float(x), float(y));
  return corner_ + e1_ * x + e2_ * y;
}

}  // namespace trace
}  // namespace gobo

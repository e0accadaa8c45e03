// SPDX-License-Identifier: Apache-2.0
#include "trace/spherical_triangle.h"

#include <algorithm>
#include <cmath>

namespace gobo {
inline namespace trace {
namespace {

/// Height above the triangle's plane, over distances and coordinates, from which on it is more than rounding.
constexpr double kPlane = 1e-5;

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
  const DVec3 A = corner_, B = corner_ + e1_, C = corner_ + e2_;
  const double la = glm::length(A), lb = glm::length(B), lc = glm::length(C), longest = std::max({la, lb, lc});
  if (!(std::min({la, lb, lc}) > 1e-9 * longest)) return;
  // Products by the edges: of nearly equal corners those of the corners would be differences.
  const DVec3 ab = glm::cross(A, e1_), ac = glm::cross(A, e2_), bc = glm::cross(B, e2_ - e1_);
  const auto narrow = [](const DVec3& product, double lengths) { return !(glm::dot(product, product) > 1e-18 * lengths * lengths); };
  if (narrow(ab, la * lb) || narrow(ac, la * lc) || narrow(bc, lb * lc)) return;
  // In the triangle's plane as far as a float position can tell: a lamp's own points would see half a sphere of it, on either side.
  const double volume = std::fabs(glm::dot(A, normal_));
  const double rounding = kPlane * (longest + std::max({std::fabs(double(p.x)), std::fabs(double(p.y)), std::fabs(double(p.z))}));
  if (!(volume > rounding * 2.0 * area_)) return;
  // The angle at a: its cosine and sine times the same lengths.
  const double x = glm::dot(ab, ac), y = la * volume, h = std::sqrt(x * x + y * y);
  if (!(y > 1e-9 * h)) return;
  cosAlpha_ = x / h;
  sinAlpha_ = y / h;
  a_ = A / la;
  b_ = B / lb;
  c_ = C / lc;
  solidAngle_ = 2.0 * std::atan2(volume, la * lb * lc + glm::dot(A, B) * lc + glm::dot(B, C) * la + glm::dot(C, A) * lb);
}

DVec3 SphericalTriangle::sample(double u, double v, Vec2& barycentrics) const {
  // The corner c' for which the triangle a b c' has the share u of the solid angle; then a place on the arc from b to c'.
  const double share = u * solidAngle_, sinShare = std::sin(share), cosShare = std::cos(share);
  const double sinPhi = cosShare * sinAlpha_ - sinShare * cosAlpha_, cosPhi = -cosShare * cosAlpha_ - sinShare * sinAlpha_;
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

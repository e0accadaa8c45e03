// SPDX-License-Identifier: Apache-2.0
#include "trace/area_lights.h"

#include <algorithm>
#include <numbers>

namespace gobo {
inline namespace trace {
namespace {

constexpr double kTinySolidAngle = 1e-5;

/// The rectangle in a frame centred at the receiver: x in [x0,x1], y in [y0,y1], at depth z < 0, and its spherical quad.
struct SphericalRect {
  DVec3 x, y, z;
  double x0, x1, y0, y1, z0;
  double b0 = 0, b1 = 0, k = 0, solidAngle = 0;

  SphericalRect(const LightShape& s, const Vec3& p, const Vec3& u, const Vec3& v) {
    const double lu = glm::length(DVec3(u)), lv = glm::length(DVec3(v));
    x = DVec3(u) / lu;
    y = DVec3(v) / lv;
    z = glm::cross(x, y);
    const DVec3 d = DVec3(s.position) - DVec3(p);
    z0 = glm::dot(d, z);
    if (z0 > 0) {
      z = -z;
      z0 = -z0;
    }
    const double cx = glm::dot(d, x), cy = glm::dot(d, y);
    x0 = cx - lu;
    x1 = cx + lu;
    y0 = cy - lv;
    y1 = cy + lv;
    if (!(z0 < 0)) return;
    // z components of the four edge planes' normals; the normals have no other component in common.
    const double n0 = -y0 / std::sqrt(z0 * z0 + y0 * y0), n1 = x1 / std::sqrt(z0 * z0 + x1 * x1);
    const double n2 = y1 / std::sqrt(z0 * z0 + y1 * y1), n3 = -x0 / std::sqrt(z0 * z0 + x0 * x0);
    const double g0 = std::acos(-n0 * n1), g1 = std::acos(-n1 * n2), g2 = std::acos(-n2 * n3), g3 = std::acos(-n3 * n0);
    b0 = n0;
    b1 = n2;
    k = 2 * std::numbers::pi - g2 - g3;
    solidAngle = g0 + g1 - k;
  }

  DVec3 sample(double u, double v) const {
    const double a = u * solidAngle + k;
    const double f = (std::cos(a) * b0 - b1) / std::sin(a);  // 0/0 falls through both tests below to an end of the edge
    // The paper's xu = -cu z0 / sqrt(1 - cu^2) with cu^2 = 1 / (f^2 + b0^2), freed of the difference 1 - cu^2.
    const double f2 = f * f - z0 * z0 / (z0 * z0 + y0 * y0);
    const double xu = f2 > 0 ? std::clamp(std::copysign(z0 / std::sqrt(f2), f), x0, x1) : (f > 0 ? x1 : x0);
    const double d2 = xu * xu + z0 * z0;
    const double h0 = y0 / std::sqrt(d2 + y0 * y0), h1 = y1 / std::sqrt(d2 + y1 * y1);
    const double h = h0 + v * (h1 - h0), h2 = h * h;
    const double yv = h2 < 1.0 - 1e-14 ? std::clamp(h * std::sqrt(d2 / (1.0 - h2)), y0, y1) : (h > 0 ? y1 : y0);
    return xu * x + yv * y + z0 * z;
  }
};

bool finish(const DVec3& d, double pdf, AreaSample& out) {
  const double l = glm::length(d);
  out.direction = Vec3(d / l);
  out.distance = float(l);
  out.pdf = float(std::min(pdf, 1e37));
  return l > 0 && out.distance > 0.0f && out.pdf > 0.0f;
}

/// Density of uniform-area sampling, as solid angle.
double areaPdf(double cosine, double d2, double area) { return cosine > 0 ? d2 / (cosine * area) : 0.0; }

bool facing(const LightShape& s, const Vec3& p) {
  const double side = glm::dot(DVec3(p) - DVec3(s.position), DVec3(s.axis));
  return s.twoSided ? side != 0 : side > 0;
}

/// Half edges of the square around a disk.
void diskSquare(const LightShape& s, Vec3& u, Vec3& v) {
  const Frame frame(s.axis);
  u = frame.x * s.radius;
  v = frame.y * s.radius;
}
bool diskByArea(const LightShape& s, const Vec3& p) {
  const DVec3 d = DVec3(s.position) - DVec3(p);
  return glm::dot(d, d) > 9.0 * double(s.radius) * s.radius;
}

}  // namespace

double rectSolidAngle(const LightShape& s, const Vec3& p) { return std::max(SphericalRect(s, p, s.u, s.v).solidAngle, 0.0); }

bool sampleRect(const LightShape& s, const Vec3& p, const Vec2& u, AreaSample& out) {
  if (!facing(s, p)) return false;
  const SphericalRect r(s, p, s.u, s.v);
  if (r.solidAngle >= kTinySolidAngle) return finish(r.sample(u.x, u.y), 1.0 / r.solidAngle, out);
  const DVec3 d = DVec3(s.position) - DVec3(p) + DVec3(s.u) * (2.0 * u.x - 1.0) + DVec3(s.v) * (2.0 * u.y - 1.0);
  const double d2 = glm::dot(d, d), area = (r.x1 - r.x0) * (r.y1 - r.y0);
  return finish(d, areaPdf(std::fabs(r.z0) / std::sqrt(d2), d2, area), out);
}

float rectPdf(const LightShape& s, const Vec3& p, const Vec3& direction, float t) {
  if (!facing(s, p)) return 0.0f;
  const SphericalRect r(s, p, s.u, s.v);
  if (r.solidAngle >= kTinySolidAngle) return float(1.0 / r.solidAngle);
  const double area = (r.x1 - r.x0) * (r.y1 - r.y0);
  return float(std::min(areaPdf(std::fabs(glm::dot(DVec3(direction), r.z)), double(t) * t, area), 1e37));
}

bool sampleDisk(const LightShape& s, const Vec3& p, const Vec2& u, AreaSample& out) {
  if (!facing(s, p)) return false;
  Vec3 ex, ey;
  diskSquare(s, ex, ey);
  const DVec3 toCentre = DVec3(s.position) - DVec3(p);
  if (!diskByArea(s, p)) {
    const SphericalRect r(s, p, ex, ey);
    const DVec3 d = r.sample(u.x, u.y), fromCentre = d - toCentre;
    if (!(r.solidAngle > 0) || glm::dot(fromCentre, fromCentre) > double(s.radius) * s.radius) return false;
    return finish(d, 1.0 / r.solidAngle, out);
  }
  const double phi = 2.0 * std::numbers::pi * u.x, radius = std::sqrt(double(u.y));
  const DVec3 d = toCentre + radius * (std::cos(phi) * DVec3(ex) + std::sin(phi) * DVec3(ey));
  const double d2 = glm::dot(d, d);
  return finish(d, areaPdf(std::fabs(glm::dot(d, DVec3(s.axis))) / std::sqrt(d2), d2, std::numbers::pi * s.radius * s.radius), out);
}

float diskPdf(const LightShape& s, const Vec3& p, const Vec3& direction, float t) {
  if (!facing(s, p)) return 0.0f;
  if (!diskByArea(s, p)) {
    Vec3 ex, ey;
    diskSquare(s, ex, ey);
    const double solidAngle = SphericalRect(s, p, ex, ey).solidAngle;
    return solidAngle > 0 ? float(1.0 / solidAngle) : 0.0f;
  }
  const double cosine = std::fabs(glm::dot(DVec3(direction), DVec3(s.axis)));
  return float(std::min(areaPdf(cosine, double(t) * t, std::numbers::pi * s.radius * s.radius), 1e37));
}

namespace {
/// 1 - cos of the cone's half angle from its sine squared: no cancellation for small cones.
double oneMinusCos(double sin2) { return sin2 / (1.0 + std::sqrt(std::max(1.0 - sin2, 0.0))); }
}  // namespace

bool sampleSphere(const LightShape& s, const Vec3& p, const Vec2& u, AreaSample& out) {
  const DVec3 c = DVec3(s.position) - DVec3(p);
  const double d2 = glm::dot(c, c), r2 = double(s.radius) * s.radius;
  if (!(d2 > r2) || !(r2 > 0)) return false;
  const double d = std::sqrt(d2), cone = oneMinusCos(r2 / d2);
  const double m = double(u.x) * cone;  // 1 - cos of the sampled angle
  const double sin2 = m * (2.0 - m), sine = std::sqrt(sin2), phi = 2.0 * std::numbers::pi * u.y;
  const DVec3 z = c / d;
  const DVec3 x = glm::normalize(std::fabs(z.x) > 0.6 ? glm::cross(z, DVec3(0, 1, 0)) : glm::cross(z, DVec3(1, 0, 0)));
  const DVec3 direction = (1.0 - m) * z + sine * (std::cos(phi) * x + std::sin(phi) * glm::cross(z, x));
  const double half = std::sqrt(std::max(r2 - d2 * sin2, 0.0));
  out.direction = Vec3(direction);
  // (d^2 - r^2) / (far root) is the near root without the difference of two large numbers.
  out.distance = float((d2 - r2) / (d * (1.0 - m) + half));
  out.pdf = float(std::min(1.0 / (2.0 * std::numbers::pi * cone), 1e37));
  return out.distance > 0.0f;
}

float spherePdf(const LightShape& s, const Vec3& p) {
  const DVec3 c = DVec3(s.position) - DVec3(p);
  const double d2 = glm::dot(c, c), r2 = double(s.radius) * s.radius;
  if (!(d2 > r2) || !(r2 > 0)) return 0.0f;
  return float(std::min(1.0 / (2.0 * std::numbers::pi * oneMinusCos(r2 / d2)), 1e37));
}

bool intersectAreaLight(const LightShape& s, const Ray& ray, float& t, Vec3& Ng) {
  const DVec3 o = DVec3(ray.origin) - DVec3(s.position), d(ray.direction);
  double hit;
  if (s.kind == LightKind::Sphere) {
    const double b = -glm::dot(o, d), r2 = double(s.radius) * s.radius;
    const DVec3 across = o + b * d;  // the ray's nearest point to the centre: b^2 - |o|^2 would lose a small sphere far away
    const double disc = r2 - glm::dot(across, across), c = glm::dot(o, o) - r2;
    if (!(disc >= 0) || !(c > 0) || !(b > 0)) return false;
    hit = c / (b + std::sqrt(disc));
  } else {
    const DVec3 n(s.axis);
    const double cosine = glm::dot(d, n);
    if (s.twoSided ? cosine == 0 : !(cosine < 0)) return false;
    hit = -glm::dot(o, n) / cosine;
    const DVec3 q = o + hit * d;
    if (s.kind == LightKind::Disk) {
      if (!(glm::dot(q, q) <= double(s.radius) * s.radius)) return false;
    } else {
      const DVec3 u(s.u), v(s.v);
      if (!(std::fabs(glm::dot(q, u)) <= glm::dot(u, u) && std::fabs(glm::dot(q, v)) <= glm::dot(v, v))) return false;
    }
  }
  // Compared as the float that is handed out: asking again from tmin = t must not find the same light again.
  const float rounded = float(hit);
  if (!(rounded > ray.tmin && rounded < ray.tmax)) return false;
  t = rounded;
  Ng = s.kind == LightKind::Sphere ? Vec3(glm::normalize(o + hit * d)) : s.axis;
  return true;
}

}  // namespace trace
}  // namespace gobo

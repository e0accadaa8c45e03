// SPDX-License-Identifier: Apache-2.0
#include "terms/light_points.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "base/disk.h"
#include "scene/light_axes.h"

namespace gobo {
inline namespace terms {

namespace {

/// A direction of the cap around `axis` whose rim has 1 - cosine = `cone`; d in the unit disk, area-preserving.
Vec3 inCap(const Vec3& axis, float cone, const Vec2& d) {
  const float drop = glm::dot(d, d) * cone, side = std::sqrt(std::max(cone * (2.0f - drop), 0.0f));
  const Frame f(axis);
  return f.x * (d.x * side) + f.y * (d.y * side) + f.z * (1.0f - drop);
}

}  // namespace

LightPoints::LightPoints(const SceneView& view, int light) : shape_(view.lightShape(light)) {
  GOBO_CHECK(shape_.kind != LightKind::Environment);
  if (shape_.kind == LightKind::Disk) {
    const Frame f(glm::normalize(shape_.axis));
    tangent_ = f.x * shape_.radius;
    bitangent_ = f.y * shape_.radius;
  }
  if (shape_.kind == LightKind::Directional && shape_.angularSize != 0.0f) {
    const double sine = std::sin(0.5 * double(shape_.angularSize));
    sun_ = float(sine * sine / (1.0 + std::sqrt(1.0 - sine * sine)));
  } else if (isWideDirectional(shape_)) {
    const Frame f = mapFrame(shape_);
    tangent_ = 0.5f * shape_.skyRectangle.x * f.x;
    bitangent_ = 0.5f * shape_.skyRectangle.y * f.y;
  }
  centre_ = shape_.position;
  if (shape_.kind == LightKind::Rect) radius_ = glm::length(shape_.u) + glm::length(shape_.v);
  if (shape_.kind == LightKind::Disk || shape_.kind == LightKind::Sphere) radius_ = shape_.radius;
  if (shape_.kind != LightKind::Mesh) return;
  const Instance& instance = view.instances()[shape_.instance];
  const auto mesh = view.mesh<Facet::Topology | Facet::Pose>(instance.mesh);
  meshTwoSided_ = view.coverage(mesh.material).doubleSided;
  const float handed = glm::determinant(Mat3(instance.toWorld)) < 0.0f ? -1.0f : 1.0f;  // a mirroring instance keeps outside outside
  auto world = [&](uint32_t i) { return Vec3(instance.toWorld * Vec4(mesh.positions[i], 1.0f)); };
  double total = 0;
  for (size_t t = 0; t < mesh.triangles(); ++t) {
    const Vec3 a = world(mesh.indices[3 * t]), ab = world(mesh.indices[3 * t + 1]) - a, ac = world(mesh.indices[3 * t + 2]) - a;
    const Vec3 n = handed * glm::cross(ab, ac);
    const double area = std::sqrt(glm::dot(DVec3(n), DVec3(n)));
    if (!(area > 0)) continue;
    total += area;
    triangles_.push_back({a, ab, ac, Vec3(DVec3(n) / area)});
    cumulated_.push_back(total);
  }
  for (double& c : cumulated_) c /= total;
}

bool LightPoints::surelyDark(const Vec3& p, const Vec3& N) const {
  constexpr float kRoom = 1e-4f;  // of lengths and sines: far more than rounding
  if (shape_.kind == LightKind::Directional) {
    if (!(sun_ > 0.0f)) return false;
    const float cosine = -glm::dot(N, glm::normalize(shape_.axis)), sine = std::sqrt(std::max(1.0f - sqr(cosine), 0.0f));
    return cosine < 0.0f && cosine * (1.0f - sun_) + sine * std::sqrt(sun_ * (2.0f - sun_)) < -kRoom;  // of the disk's highest point
  }
  if (!(radius_ > 0.0f)) return false;
  const Vec3 to = centre_ - p;
  const float room = kRoom * (glm::length(to) + radius_);
  if (glm::dot(N, to) + radius_ < -room) return true;
  return (shape_.kind == LightKind::Rect || shape_.kind == LightKind::Disk) && !shape_.twoSided && glm::dot(shape_.axis, to) > room;
}

bool LightPoints::sample(const Vec3& p, const Vec3& N, const Vec3& Ng, Vec2 u, LightPoint& out) const {
  Vec3 to, emitter(0.0f);  // towards the point; its normal (area lights)
  bool twoSided = shape_.twoSided;
  switch (shape_.kind) {
    case LightKind::Directional:
      if (pointLike()) out.direction = -shape_.axis;
      else if (sun_ > 0.0f) out.direction = inCap(-glm::normalize(shape_.axis), sun_, concentricDisk(u));
      else out.direction = glm::normalize((2.0f * u.x - 1.0f) * tangent_ + (2.0f * u.y - 1.0f) * bitangent_ - shape_.axis);
      out.distance = 3.0e38f;
      break;
    case LightKind::Point:
    case LightKind::Spot: to = shape_.position - p; break;
    case LightKind::Rect:
      to = shape_.position + (2.0f * u.x - 1.0f) * shape_.u + (2.0f * u.y - 1.0f) * shape_.v - p;
      emitter = shape_.axis;
      break;
    case LightKind::Disk: {
      const Vec2 d = concentricDisk(u);
      to = shape_.position + d.x * tangent_ + d.y * bitangent_ - p;
      emitter = shape_.axis;
      break;
    }
    case LightKind::Sphere: {
      const Vec3 c = shape_.position - p;
      const float centre2 = glm::dot(c, c), sin2 = sqr(shape_.radius) / centre2;
      if (!(sin2 < 1.0f)) return false;
      const float cone = sin2 / (1.0f + std::sqrt(1.0f - sin2));  // 1 - cos(cone) without cancellation
      const Vec2 d = concentricDisk(u);
      const float r2 = glm::dot(d, d), drop = r2 * cone, cosine = 1.0f - drop;
      const float side = std::sqrt(std::max(cone * (2.0f - drop), 0.0f));  // sin(theta) = sqrt(r2) * side
      const Frame f(c / std::sqrt(centre2));
      out.direction = f.x * (d.x * side) + f.y * (d.y * side) + f.z * cosine;
      out.distance = std::sqrt(centre2) * cosine - std::sqrt(std::max(sqr(shape_.radius) - centre2 * r2 * sqr(side), 0.0f));
      break;
    }
    case LightKind::Mesh: {
      if (cumulated_.empty()) return false;
      const size_t t = std::min(size_t(std::upper_bound(cumulated_.begin(), cumulated_.end(), double(u.x)) - cumulated_.begin()), cumulated_.size() - 1);
      const double from = t > 0 ? cumulated_[t - 1] : 0.0;
      const float rest = clamp01(float((double(u.x) - from) / (cumulated_[t] - from)));
      const float root = std::sqrt(rest);
      to = triangles_[t].a + (1.0f - root) * triangles_[t].ab + (root * u.y) * triangles_[t].ac - p;
      emitter = triangles_[t].normal;
      twoSided = meshTwoSided_;
      break;
    }
    case LightKind::Environment: return false;
  }
  if (shape_.kind != LightKind::Directional && shape_.kind != LightKind::Sphere) {
    const float d2 = glm::dot(to, to);
    if (!(d2 > 0.0f)) return false;
    out.distance = std::sqrt(d2);
    out.direction = to / out.distance;
  }
  const float cosine = glm::dot(N, out.direction);
  if (!(cosine > 0.0f)) return false;
  out.weight = cosine;
  switch (shape_.kind) {
    case LightKind::Spot:
      if (glm::dot(-out.direction, shape_.axis) <= shape_.cosOuter) return false;
      [[fallthrough]];
    case LightKind::Point:
      if (shape_.range > 0.0f && out.distance > shape_.range) return false;
      out.weight = 1.0f;
      break;
    case LightKind::Directional: {
      if (pointLike()) {
        out.weight = 1.0f;
      } else if (!(sun_ > 0.0f)) {
        const float along = -glm::dot(shape_.axis, out.direction);  // solid angle of an element of the tangent plane: cos^3
        out.weight = cosine * along * along * along;
      }
      break;
    }
    case LightKind::Rect:
    case LightKind::Disk:
    case LightKind::Mesh: {
      const float signedCosine = -glm::dot(emitter, out.direction);
      const float facing = twoSided ? std::fabs(signedCosine) : signedCosine;
      if (!(facing > 0.0f)) return false;
      out.weight = cosine * facing / sqr(out.distance);
      break;
    }
    default: break;
  }
  out.belowSurface = !(glm::dot(Ng, out.direction) > 0.0f);
  return out.weight > 0.0f && std::isfinite(out.weight);
}

Ray shadowRay(const Vec3& reach, const Vec3& p, const Vec3& Ng, const LightPoint& point) {
  Ray ray;
  ray.origin = offsetOrigin(p, Ng, reach);
  if (point.distance >= 3.0e38f) {
    ray.direction = point.direction;
    return ray;
  }
  const Vec3 to = p + point.direction * point.distance - ray.origin;
  const float length = glm::length(to);
  ray.direction = length > 0.0f ? to / length : point.direction;
  ray.tmax = length * kShadowRayEnd;
  return ray;
}

}  // namespace terms
}  // namespace gobo

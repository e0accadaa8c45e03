// SPDX-License-Identifier: Apache-2.0
#include "trace/photon_emission.h"

#include <algorithm>

#include "trace/spot_falloff.h"

namespace gobo {
inline namespace trace {

namespace {

constexpr size_t kMostTargets = 64;
constexpr float kWidestPicture = 0.25f;  // cosine of a cone beyond which cells of a plane are too uneven by solid angle

bool maySmooth(float roughness, bool textured) { return textured || roughness * roughness < kDeltaAlpha; }

/// Box of one instance, widened to hold rounding.
Sphere instanceSphere(const SceneView& view, const Instance& instance) {
  const auto mesh = view.mesh<Facet::Pose>(instance.mesh);
  if (mesh.positions.empty()) return {};
  const glm::dmat4 toWorld(instance.toWorld);
  DVec3 lo(1e300), hi(-1e300);
  for (const Vec3& v : mesh.positions) {
    const DVec3 w(toWorld * glm::dvec4(DVec3(v), 1.0));
    lo = glm::min(lo, w);
    hi = glm::max(hi, w);
  }
  const DVec3 centre = 0.5 * (lo + hi);
  double most = 0;  // about the box's centre: tighter than the box's own sphere
  for (const Vec3& v : mesh.positions) {
    const DVec3 d = DVec3(toWorld * glm::dvec4(DVec3(v), 1.0)) - centre;
    most = std::max(most, glm::dot(d, d));
  }
  const double size = std::sqrt(most), reach = std::max({std::fabs(centre.x), std::fabs(centre.y), std::fabs(centre.z)});
  return {Vec3(centre), float(size * 1.0001 + reach * 1e-6)};
}

Sphere around(const std::vector<Sphere>& spheres) {
  DVec3 lo(1e300), hi(-1e300);
  for (const Sphere& s : spheres) {
    lo = glm::min(lo, DVec3(s.centre) - double(s.radius));
    hi = glm::max(hi, DVec3(s.centre) + double(s.radius));
  }
  if (spheres.empty()) return {};
  return {Vec3(0.5 * (lo + hi)), float(0.5001 * glm::length(hi - lo))};
}

/// gap: 1 - cosine of the half angle.
Vec3 inCone(const Vec3& axis, double gap, const Vec2& u) {
  const double g = double(u.x) * gap, z = 1.0 - g, r = std::sqrt(g * (2.0 - g)), phi = 2.0 * M_PI * double(u.y);
  return glm::normalize(Frame(axis).toWorld(Vec3(float(r * std::cos(phi)), float(r * std::sin(phi)), float(z))));
}

}  // namespace

bool mayBeSpecular(const SurfaceMaterial& m) {
  if (m.unlit) return false;
  const BsdfParams& p = m.constant;
  const bool interface = p.metallic > 0.0f || p.transmission > 0.0f || p.specular > 0.0f || p.iridescence > 0.0f;
  return m.interior >= 0 || (p.transmission > 0.0f && std::fabs(p.ior - 1.0f) < 1e-3f) || (interface && maySmooth(p.roughness, bool(m.metallicRoughness))) ||
         (p.clearcoat > 0.0f && maySmooth(p.clearcoatRoughness, bool(m.clearcoatRoughness)));
}

std::vector<Sphere> specularTargets(const SceneView& view, const SurfaceTable& surfaces) {
  std::vector<Sphere> out;
  for (size_t i = 0; i < view.instances().size(); ++i) {
    if (!mayBeSpecular(*surfaces.instance(uint32_t(i)).material)) continue;
    const Sphere s = instanceSphere(view, view.instances()[i]);
    if (s.radius > 0.0f) out.push_back(s);
  }
  if (out.size() > kMostTargets) out.assign(1, around(out));
  return out;
}

Sphere sceneSphere(const SceneView& view) {
  std::vector<Sphere> all;
  for (const Instance& i : view.instances())
    if (const Sphere s = instanceSphere(view, i); s.radius > 0.0f) all.push_back(s);
  return around(all);
}

PhotonEmitter::PhotonEmitter(const LightShape& light, std::vector<Sphere> spheres, const Sphere& scene, LightProfilePtr profile) : light_(light) {
  for (const Sphere& s : spheres) {
    Target t;
    t.centre = s.centre;
    t.radius = s.radius;
    if (light.kind == LightKind::Directional) {
      t.weight = M_PI * double(s.radius) * s.radius;
    } else {
      const DVec3 d = DVec3(s.centre) - DVec3(light.position);
      const double d2 = glm::dot(d, d), r2 = double(s.radius) * s.radius;
      t.axis = d2 > r2 ? Vec3(d / std::sqrt(d2)) : Vec3(0, 0, 1);
      if (d2 > r2) {
        t.sine2 = float(r2 / d2);
        t.gap = r2 / d2 / (1.0 + std::sqrt(1.0 - r2 / d2));
      }
      t.weight = 2.0 * M_PI * t.gap;
    }
    total_ += t.weight;
    t.until = total_;
    targets_.push_back(t);
  }
  const double cone = 2.0 * M_PI * (1.0 - double(light.cosOuter));
  if (light.kind == LightKind::Spot && !targets_.empty() && cone < total_) {
    byCone_ = true;
    total_ = cone;
  }
  if (profile && hasProfile(light)) {
    profile_.emplace(light, profile);
    distribution_.emplace(light, std::move(profile));
    if (!(distribution_->flux() > 0.0)) total_ = 0.0;  // black all over
    else byProfile_ = distribution_->solidAngle() < total_ && (light.kind == LightKind::Point || light.cosOuter > kWidestPicture);
  }
  if (light.kind == LightKind::Directional) away_ = glm::length(scene.centre) * 1e-3f + 2.1f * scene.radius;
}

double PhotonEmitter::density(const Vec3& direction, const Vec3& point) const {
  double sum = 0;
  for (const Target& t : targets_) {
    if (light_.kind == LightKind::Directional) {
      const Vec3 d = point - t.centre, across = d - light_.axis * glm::dot(d, light_.axis);
      sum += glm::dot(across, across) <= t.radius * t.radius;
    } else {
      const float c = glm::dot(direction, t.axis);
      const Vec3 across = direction - t.axis * c;
      sum += t.sine2 > 1.0f || (c > 0.0f && glm::dot(across, across) <= t.sine2);
    }
  }
  return std::max(sum, 1.0) / total_;  // the target that was drawn from counts, however its edge was rounded
}

bool PhotonEmitter::emit(float uTarget, const Vec2& u, PhotonStart& out) const {
  if (!(total_ > 0.0) || targets_.empty()) return false;
  if (byProfile_) {
    double density = 0;
    out.origin = light_.position;
    if (!distribution_->sample(uTarget, u, out.direction, density)) return false;
    out.power = float(1.0 / density);
    if (light_.kind == LightKind::Spot) out.power *= spotFalloff(light_, glm::dot(out.direction, light_.axis));
    return tinted(out);
  }
  if (byCone_) {
    out.origin = light_.position;
    out.direction = inCone(light_.axis, 1.0 - double(light_.cosOuter), u);
    out.power = float(double(spotFalloff(light_, glm::dot(out.direction, light_.axis))) * total_);
    return tinted(out);
  }
  const double at = double(uTarget) * total_;
  const auto it = std::find_if(targets_.begin(), targets_.end() - 1, [at](const Target& t) { return at < t.until; });
  if (light_.kind == LightKind::Directional) {
    const double r = double(it->radius) * std::sqrt(double(u.x)), phi = 2.0 * M_PI * double(u.y);
    const Vec3 p = it->centre + Frame(light_.axis).toWorld(Vec3(float(r * std::cos(phi)), float(r * std::sin(phi)), 0.0f));
    out.direction = light_.axis;
    out.origin = p - light_.axis * away_;
    out.power = float(1.0 / density(out.direction, p));
    return true;
  }
  out.origin = light_.position;
  out.direction = inCone(it->axis, it->gap, u);
  out.power = float(1.0 / density(out.direction, out.origin));
  if (light_.kind == LightKind::Spot) out.power *= spotFalloff(light_, glm::dot(out.direction, light_.axis));
  return tinted(out);
}

bool PhotonEmitter::tinted(PhotonStart& out) const {
  if (profile_) out.tint = profile_->at(out.direction);
  return out.power > 0.0f && maxComponent(out.tint) > 0.0f;
}

float PhotonEmitter::window(float length) const {
  if (light_.kind == LightKind::Directional || !(light_.range > 0.0f)) return 1.0f;
  const double x = double(length) / light_.range, w = 1.0 - x * x * x * x;
  return float(std::min(std::max(w, 0.0), 1.0));
}

}  // namespace trace
}  // namespace gobo

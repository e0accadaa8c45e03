// SPDX-License-Identifier: Apache-2.0
// The dispatcher: one record per light of the subset, found by its index in the scene.
#include "trace/light_sampling.h"

#include <algorithm>
#include <optional>

#include "base/check.h"
#include "trace/area_light_bvh.h"
#include "trace/area_lights.h"
#include "trace/distant_light.h"
#include "trace/emission_profile.h"
#include "trace/environment_distribution.h"
#include "trace/mesh_light.h"
#include "trace/spot_falloff.h"

namespace gobo {
inline namespace trace {
namespace {

/// Intensity over distance squared is cut at this distance, so that a receiver on the lamp gets a finite value.
constexpr double kNearest = 1e-6;
constexpr float kInfinity = 3e38f;

/// KHR_lights_punctual: what distance leaves of an intensity, window of `range` included.
double distanceFalloff(double d2, float range) {
  double window = 1.0;
  if (range > 0.0f) {
    const double x = d2 / (double(range) * range);
    window = std::clamp(1.0 - x * x, 0.0, 1.0);
  }
  return window / std::max(d2, kNearest * kNearest);
}

bool samplePoint(const LightShape& s, const EmissionProfile* profile, const Vec3& p, LightSample& out) {
  const DVec3 d = DVec3(s.position) - DVec3(p);
  const double d2 = glm::dot(d, d);
  if (!(d2 > 0)) return false;
  const double distance = std::sqrt(d2);
  out.direction = Vec3(d / distance);
  out.distance = float(distance);
  double value = distanceFalloff(d2, s.range);
  if (s.kind == LightKind::Spot) value *= spotFalloff(s, -glm::dot(out.direction, s.axis));
  out.radiance = Vec3(float(value));
  out.pdf = 1.0f;
  out.delta = true;
  if (profile) {
    out.radiance *= profile->at(-out.direction);
    if (!(maxComponent(out.radiance) > 0.0f)) return false;
  }
  return value > 0 && out.distance > 0.0f;
}

}  // namespace

struct LightSampler::Impl {
  std::vector<int> slots;          // light index -> record, -1 outside the subset
  std::vector<LightShape> shapes;  // one per record
  std::vector<int> own;            // record -> meshes, distant or profiles, -1 for other kinds
  std::vector<MeshLight> meshes;
  std::vector<DistantLight> distant;      // Directional lights of some angular size
  std::vector<EmissionProfile> profiles;  // of Point and Spot lights that have one
  EnvironmentPtr environment;
  std::optional<EnvironmentDistribution> distribution;
  AreaLightBvh area;

  int record(int light) const {
    GOBO_CHECK_LE(0, light);
    GOBO_CHECK_LT(size_t(light), slots.size());
    GOBO_CHECK_LE(0, slots[light]);
    return slots[light];
  }
};

LightSampler::LightSampler() : impl_(std::make_unique<Impl>()) {}
LightSampler::~LightSampler() = default;

std::shared_ptr<const LightSampler> LightSampler::build(const SceneView& view, const StopToken& stop, bool draws) {
  std::shared_ptr<LightSampler> sampler(new LightSampler);
  Impl& m = *sampler->impl_;
  std::vector<AreaLightBvh::Entry> area;
  for (int i : view.lightSubset()) {
    if (size_t(i) >= m.slots.size()) m.slots.resize(size_t(i) + 1, -1);
    m.slots[i] = int(m.shapes.size());
    const LightShape& s = view.lightShape(i);
    m.shapes.push_back(s);
    m.own.push_back(-1);
    switch (s.kind) {
      case LightKind::Rect:
      case LightKind::Disk:
      case LightKind::Sphere: area.push_back({i, s, view.lightCameraVisible(i)}); break;
      case LightKind::Mesh:
        m.own.back() = int(m.meshes.size());
        m.meshes.emplace_back(view, s.instance, stop);
        break;
      case LightKind::Point:
      case LightKind::Spot:
        if (!hasProfile(s)) break;
        m.own.back() = int(m.profiles.size());
        m.profiles.emplace_back(s, view.lightProfile(i));
        break;
      case LightKind::Directional:
        if (isDeltaLight(s)) break;
        m.own.back() = int(m.distant.size());
        m.distant.emplace_back(s);
        break;
      case LightKind::Environment:
        m.environment = view.environment();
        if (draws && !m.distribution) m.distribution.emplace(m.environment, stop);
        break;
    }
    if (stop.stopRequested()) return nullptr;
  }
  m.area = AreaLightBvh(std::move(area));
  return sampler;
}

bool LightSampler::sample(int i, const Vec3& p, const Vec2& u, LightSample& out) const {
  out = {};
  const int r = impl_->record(i);
  const LightShape& s = impl_->shapes[r];
  AreaSample a;
  bool ok = false;
  Vec3 radiance(1.0f);
  switch (s.kind) {
    case LightKind::Point:
    case LightKind::Spot: return samplePoint(s, impl_->own[r] < 0 ? nullptr : &impl_->profiles[impl_->own[r]], p, out);
    case LightKind::Directional: {
      if (impl_->own[r] < 0) {
        out = {-s.axis, kInfinity, Vec3(1.0f), 1.0f, true};
        return true;
      }
      const DistantLight& sun = impl_->distant[impl_->own[r]];
      double density;
      out.direction = sun.sample(u, density);
      out.distance = kInfinity;
      out.radiance = Vec3(float(1.0 / sun.irradiance()));
      out.pdf = float(density);
      return out.pdf > 0.0f;
    }
    case LightKind::Environment:
      GOBO_CHECK(impl_->distribution);
      out.distance = kInfinity;
      return impl_->distribution->sample(u, out.direction, out.radiance, out.pdf);
    case LightKind::Rect: ok = sampleRect(s, p, u, a); break;
    case LightKind::Disk: ok = sampleDisk(s, p, u, a); break;
    case LightKind::Sphere: ok = sampleSphere(s, p, u, a); break;
    case LightKind::Mesh: ok = impl_->meshes[impl_->own[r]].sample(p, u, a, radiance); break;
  }
  if (!ok) return false;
  out = {a.direction, a.distance, radiance, a.pdf, false};
  return true;
}

float LightSampler::pdf(int i, const Vec3& p, const Vec3& direction, float t, uint32_t primitive) const {
  const int r = impl_->record(i);
  const LightShape& s = impl_->shapes[r];
  switch (s.kind) {
    case LightKind::Rect: return rectPdf(s, p, direction, t);
    case LightKind::Disk: return diskPdf(s, p, direction, t);
    case LightKind::Sphere: return spherePdf(s, p);
    case LightKind::Directional: return impl_->own[r] < 0 ? 0.0f : float(impl_->distant[impl_->own[r]].pdf(direction));
    case LightKind::Mesh: return impl_->meshes[impl_->own[r]].pdf(p, direction, t, primitive);
    case LightKind::Environment: GOBO_CHECK(impl_->distribution); return impl_->distribution->pdf(direction);
    default: return 0.0f;
  }
}

float LightSampler::pdf(int i, const Vec3& p, const Vec3& direction, float t, uint32_t primitive, const Vec3& emitted) const {
  if (impl_->shapes[impl_->record(i)].kind != LightKind::Environment) return pdf(i, p, direction, t, primitive);
  GOBO_CHECK(impl_->distribution);
  return impl_->distribution->pdfOf(emitted);
}

Vec3 LightSampler::emitted(int i, const Vec3& direction, uint32_t primitive, float u, float v, const Vec3& Ng) const {
  const int r = impl_->record(i);
  const LightShape& s = impl_->shapes[r];
  switch (s.kind) {
    case LightKind::Rect:
    case LightKind::Disk: return Vec3(s.twoSided || glm::dot(direction, Ng) < 0.0f ? 1.0f : 0.0f);
    case LightKind::Sphere: return Vec3(glm::dot(direction, Ng) < 0.0f ? 1.0f : 0.0f);
    case LightKind::Directional: {
      if (impl_->own[r] < 0) return Vec3(0.0f);
      const DistantLight& sun = impl_->distant[impl_->own[r]];
      return Vec3(sun.pdf(direction) > 0.0 ? float(1.0 / sun.irradiance()) : 0.0f);
    }
    case LightKind::Mesh: return impl_->meshes[impl_->own[r]].emitted(direction, primitive, u, v);
    case LightKind::Environment: return impl_->environment ? impl_->environment->eval(direction) : Vec3(0.0f);
    default: return Vec3(0.0f);
  }
}

std::vector<LightFacet> LightSampler::facets(int i, size_t most, bool& twoSided) const {
  const int r = impl_->record(i);
  if (impl_->shapes[r].kind != LightKind::Mesh) return {};
  const MeshLight& mesh = impl_->meshes[impl_->own[r]];
  twoSided = mesh.doubleSided();
  return mesh.facets(most);
}

int LightSampler::intersectAreaLights(const Ray& ray, float& t, Vec3& Ng, bool cameraVisibleOnly) const {
  return impl_->area.intersect(ray, cameraVisibleOnly, t, Ng);
}

}  // namespace trace
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// What a path tracer needs to know of the volumes of its scene, and light at scattering events inside them.
#include "trace/path_media.h"

#include "trace/camera_media.h"
#include "trace/reach.h"
#include "trace/straight.h"

namespace gobo {
inline namespace trace {

namespace {

/// Some point of a mesh light, for the question which volumes it lies in.
Vec3 meshPoint(const SceneView& view, const LightShape& shape) {
  const Instance& instance = view.instances()[size_t(shape.instance)];
  const auto mesh = view.mesh<Facet::Topology | Facet::Pose>(instance.mesh);
  Vec3 sum(0.0f);
  if (mesh.triangles() > 0)
    for (int c = 0; c < 3; ++c) sum += mesh.positions[mesh.indices[size_t(c)]];
  return Vec3(instance.toWorld * Vec4(sum / 3.0f, 1.0f));
}

}  // namespace

void PathTracer::Impl::prepareMedia(const SceneView& view, const StopToken& stop) {
  if (settings.unlit && surfaces.anyUnlit()) hittable = true;
  onlyUnlit = settings.unlit && lights.empty();
  cameraMedia.clear();
  const std::vector<Interior>& interiors = surfaces.interiors();
  if (interiors.empty()) return;
  for (int material : volumesAround(view, cameraPoint(settings.camera), stop)) cameraMedia.enter(surfaces.interiorOf(material));
  mediaLights.assign(interiors.size(), 0);
  bool any = false;
  for (const LightInfo& l : lights) {
    if (!(luminance(l.nominal) > 0.0f) || !shadowRayReaches(l.kind, Receiver::Volume, Passage::Open)) continue;
    any = true;
    const LightShape& shape = view.lightShape(l.light);
    if (shape.kind == LightKind::Directional || shape.kind == LightKind::Environment) continue;
    for (int material : volumesAround(view, shape.kind == LightKind::Mesh ? meshPoint(view, shape) : shape.position, stop))
      mediaLights[size_t(surfaces.interiorOf(material))] = 1;
  }
  // Several volumes may overlap, and boundaries between them change nothing.
  for (size_t k = 0; k < interiors.size(); ++k)
    if (any && (interiors.size() > 1 || std::fabs(interiors[k].ior - 1.0f) < kStraightIor)) mediaLights[k] = 1;
}

Vec3 PathTracer::Impl::scatteredLight(const PathMedia& media, int i, const Vec3& p, const Vec3& d, const Vec3& beta, uint64_t draw, int& slot,
                                      uint64_t& rays) const {
  float select;
  const int k = selector.sample(p, nullptr, toUnit(uint32_t(draw)), select);
  if (k < 0 || !shadowRayReaches(lights[size_t(k)].kind, Receiver::Volume, Passage::Open)) return Vec3(0.0f);
  const LightInfo& l = lights[size_t(k)];
  const uint64_t place = hash64(draw, 1);
  LightSample light;
  if (!sampler->sample(l.light, p, Vec2(toUnit(uint32_t(place)), toUnit(uint32_t(place >> 32))), light)) return Vec3(0.0f);
  slot = l.slot;
  const float phase = henyeyGreenstein(glm::dot(d, light.direction), media.around(i)->g), density = light.pdf * select;
  const float weight = light.delta ? 1.0f : powerHeuristic(density, phase);
  const Vec3 value = beta * light.radiance * l.nominal * (phase * weight / density);
  if (!(maxComponent(value) > 0.0f)) return isFinite(value) ? Vec3(0.0f) : value;
  Ray ray;
  ray.origin = p;
  ray.direction = light.direction;
  // Short of the light's own surface by what rounding may have put between it and the sampled point.
  const float slack = 3e-6f * std::max(std::fabs(p.x), std::max(std::fabs(p.y), std::fabs(p.z)));
  ray.tmax = light.distance >= 3.0e38f ? 3.0e38f : std::max(0.0f, light.distance * (1.0f - 2e-5f) - slack);
  return value * transmittance(*accel, surfaces, ray, &media.stack[i], rays);
}

void PathTracer::Impl::throughPanes(uint32_t lanes, RTCRay16& r, const MediumStack* around, Vec3* left, uint64_t& rays) const {
  Ray ray[kLanes];
  MediumStack volumes[kLanes];
  int lane[kLanes], count = 0;
  Vec3 through[kLanes];
  for (; lanes; lanes &= lanes - 1) {
    const int i = __builtin_ctz(lanes);
    const Vec3 way(r.dir_x[i], r.dir_y[i], r.dir_z[i]);
    const float length = glm::length(way);
    ray[count] = {Vec3(r.org_x[i], r.org_y[i], r.org_z[i]), way / length, r.tnear[i], r.tfar[i] > 1e30f ? 3.0e38f : r.tfar[i] * length};
    if (around) volumes[count] = around[i];
    lane[count++] = i;
  }
  transmittance16(*accel, surfaces, ray, around ? volumes : nullptr, count, through, rays);
  for (int k = 0; k < count; ++k) {
    left[lane[k]] = through[k];
    if (!(maxComponent(through[k]) > 0.0f)) r.tfar[lane[k]] = -1.0f;
  }
}

}  // namespace trace
}  // namespace gobo

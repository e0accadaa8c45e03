// SPDX-License-Identifier: Apache-2.0
// What a path tracer needs to know of the volumes of its scene, and light at scattering events inside them.
#include "trace/path_media.h"

#include "trace/camera_media.h"

namespace gobo {

namespace {

constexpr int kMostBoundaries = 16;

/// Nothing but transmission, and that straight on: what passes is the surface's albedo.
bool bendsNothing(const BsdfParams& p, float ior) {
  return std::fabs(ior - 1.0f) < 1e-3f && p.transmission >= 1.0f && p.metallic <= 0.0f && p.clearcoat <= 0.0f && maxComponent(p.sheenColor) <= 0.0f &&
         p.diffuseTransmission <= 0.0f && p.iridescence <= 0.0f;
}

}  // namespace

void PathTracer::Impl::prepareMedia(const SceneView& view) {
  if (settings.unlit && surfaces.anyUnlit()) hittable = true;
  onlyUnlit = settings.unlit && lights.empty();
  cameraMedia.clear();
  const std::vector<Interior>& interiors = surfaces.interiors();
  if (interiors.empty()) return;
  for (int material : volumesAround(view, cameraPoint(settings.camera))) cameraMedia.enter(surfaces.interiorOf(material));
  mediaLights.assign(interiors.size(), 0);
  bool delta = false;
  for (const LightInfo& l : lights) {
    if (!isDeltaLight(l.kind)) continue;
    delta = true;
    if (l.kind == LightKind::Directional) continue;
    for (int material : volumesAround(view, view.lightShape(l.light).position)) mediaLights[size_t(surfaces.interiorOf(material))] = 1;
  }
  for (size_t k = 0; k < interiors.size(); ++k) if (delta && std::fabs(interiors[k].ior - 1.0f) < 1e-3f) mediaLights[k] = 1;
}

Vec3 PathTracer::Impl::scatteredLight(const PathMedia& media, int i, const Vec3& p, const Vec3& d, const Vec3& beta, uint64_t draw, int& slot, uint64_t& rays) const {
  float select;
  const int k = selector.sample(p, nullptr, toUnit(uint32_t(draw)), select);
  if (k < 0 || !isDeltaLight(lights[size_t(k)].kind)) return Vec3(0.0f);
  const LightInfo& l = lights[size_t(k)];
  LightSample light;
  if (!sampler->sample(l.light, p, Vec2(0.5f), light)) return Vec3(0.0f);
  slot = l.slot;
  PathMedia along;                                  // of the volumes from here to the light only lane 0 is used
  along.interiors = media.interiors;
  along.walking = 0;
  along.stack[0] = media.stack[i];
  Vec3 value = beta * light.radiance * l.nominal * (henyeyGreenstein(glm::dot(d, light.direction), media.around(i)->g) / (light.pdf * select));
  Ray ray;
  ray.origin = p;
  ray.direction = light.direction;
  float left = light.distance;
  for (int boundary = 0; boundary < kMostBoundaries; ++boundary) {
    ray.tmax = left >= 3.0e38f ? 3.0e38f : left * (1.0f - 2e-5f);
    Hit hit;
    ++rays;
    if (!accel->intersect(ray, hit)) return value * along.through(0, left);
    Surface s;
    surfaces.interact(hit.instance, hit.primitive, hit.u, hit.v, hit.Ng, ray.direction, s);
    const int volume = s.material->interior;
    if (volume < 0) return Vec3(0.0f);
    value *= along.through(0, hit.t);
    if (!along.passes(0, volume, s.front)) {
      if (!bendsNothing(s.bsdf, along.relativeIor(0, volume, s.bsdf.ior, s.front))) return Vec3(0.0f);
      value *= s.bsdf.albedo;
    }
    along.cross(0, volume, s.front);
    ray.origin = s.origin(-s.facing());
    if (left < 3.0e38f) left -= hit.t;
    if (!(left > 0.0f)) return value;
  }
  return Vec3(0.0f);
}

}  // namespace gobo

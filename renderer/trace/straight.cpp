// SPDX-License-Identifier: Apache-2.0
#include "trace/straight.h"

namespace gobo {
inline namespace trace {

namespace {

/// A shadow ray on its way.
struct Straight {
  Ray ray;
  Vec3 end, through{1.0f};
  MediumStack around;
  int passes = 0;
  bool finite, solidsPass;

  Straight(const Ray& r, const MediumStack* volumes, bool passSolids) : ray(r), end(r.origin), finite(r.tmax < 3.0e38f), solidsPass(passSolids) {
    if (finite) end += r.direction * r.tmax;
    if (volumes) around = *volumes;
    else around.clear();
  }
  void absorb(const std::vector<Interior>& interiors, float t) {
    const int top = around.top();
    if (top >= 0 && interiors[size_t(top)].absorbs) through *= interiors[size_t(top)].transmittance(t);
  }
  /// Takes in what the ray met. True: it goes on from there.
  bool next(const SurfaceTable& surfaces, const Hit& hit) {
    if (!hit.valid()) {
      absorb(surfaces.interiors(), ray.tmax);
      return false;
    }
    const SurfaceMaterial& m = *surfaces.instance(hit.instance).material;
    const bool mayPass = m.straight || m.interior >= 0;
    if (++passes > kMostPasses || !(mayPass || solidsPass)) return blocked();
    absorb(surfaces.interiors(), hit.t);
    Surface s;
    surfaces.interact(hit.instance, hit.primitive, hit.u, hit.v, hit.Ng, ray.direction, s);
    Vec3 left(0.0f);
    if (mayPass) left = straightThrough(surfaces, s, ray.direction, around);
    if (!solidsPass || m.straight || maxComponent(left) > 0.0f) through *= left;
    if (!(maxComponent(through) > 0.0f)) return blocked();
    ray.origin = s.origin(-s.facing());
    ray.tmin = 0.0f;
    if (!finite) return true;
    // To the same end, whatever the steps off the surfaces did.
    const Vec3 rest = end - ray.origin;
    if (!(glm::dot(rest, ray.direction) > 0.0f)) return false;
    ray.tmax = glm::length(rest);
    ray.direction = rest / ray.tmax;
    return true;
  }
  bool blocked() {
    through = Vec3(0.0f);
    return false;
  }
};

Vec3 along(const Accel& accel, const SurfaceTable& surfaces, Straight&& way, uint64_t& rays) {
  for (;;) {
    Hit hit;
    ++rays;
    accel.intersect(way.ray, hit);
    if (!way.next(surfaces, hit)) return way.through;
  }
}

}  // namespace

bool maySendStraight(const Bsdf& b) {
  if (b.unlit || !(b.transmission > 0.0f) || b.metallic >= 1.0f) return false;
  if (std::fabs(b.ior - 1.0f) < kStraightIor) return true;
  return !boundsVolume(b) && (b.metallicRoughness.valid() || b.roughness * b.roughness < kDeltaAlpha);
}

bool hasClearSurfaces(const Scene& scene) {
  for (const Instance& i : scene.instances)
    if (maySendStraight(scene.materials[size_t(scene.meshes[size_t(i.mesh)]->material)].bsdf)) return true;
  return false;
}

bool lightGoesStraight(const Scene& scene) {
  for (const Instance& i : scene.instances) {
    const Bsdf& b = scene.materials[size_t(scene.meshes[size_t(i.mesh)]->material)].bsdf;
    if (maySendStraight(b) || (boundsVolume(b) && makeInterior(b).scatters)) return true;
  }
  return false;
}

Vec3 straightThrough(const SurfaceTable& surfaces, const Surface& s, const Vec3& d, MediumStack& around) {
  const SurfaceMaterial& m = *s.material;
  if (m.unlit) return Vec3(0.0f);
  const int volume = m.interior;
  const auto cross = [&] {
    if (s.front) around.enter(volume);
    else around.leave(volume);
  };
  if (volume >= 0 && around.passes(volume, s.front)) {
    cross();
    return Vec3(1.0f);
  }
  if (!bendsAlike(m)) return Vec3(0.0f);
  const Vec3 wo = s.frame().toLocal(-d);
  if (volume < 0) return bsdfStraight(s.bsdf, wo);
  BsdfParams p = s.bsdf;
  p.ior = around.relativeIor(surfaces.interiors(), volume, p.ior, s.front);
  const Vec3 left = bsdfStraight(p, wo);
  if (maxComponent(left) > 0.0f) cross();
  return left;
}

Vec3 transmittance(const Accel& accel, const SurfaceTable& surfaces, const Ray& ray, const MediumStack* around, uint64_t& rays) {
  return along(accel, surfaces, Straight(ray, around, false), rays);
}

Vec3 tint(const Accel& accel, const SurfaceTable& surfaces, const Ray& ray, uint64_t& rays) {
  return along(accel, surfaces, Straight(ray, nullptr, true), rays);
}

void transmittance16(const Accel& accel, const SurfaceTable& surfaces, const Ray* rays, const MediumStack* around, int count, Vec3* out, uint64_t& traced) {
  traced += uint64_t(count);
  Hit hits[16];
  accel.intersect16(rays, count, hits);
  // Most rays end at the first hit, or meet none: what is left goes on one by one.
  for (int i = 0; i < count; ++i) {
    Straight way(rays[i], around ? around + i : nullptr, false);
    out[i] = way.next(surfaces, hits[i]) ? along(accel, surfaces, std::move(way), traced) : way.through;
  }
}

}  // namespace trace
}  // namespace gobo

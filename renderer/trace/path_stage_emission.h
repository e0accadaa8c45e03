// SPDX-License-Identifier: Apache-2.0
// Stage: what the rays met. Lights are collected; paths that end there leave; lanes at a surface are sorted by what shades them.
#pragma once

#include "trace/area_lights.h"
#include "trace/path_chunk.h"

namespace gobo {
inline namespace trace {

/// The ray of lane i found light k, which sends `radiance` (for power 1) along it; `t`, `primitive` as LightSampler::pdf wants them.
template <PathSink Sink>
inline void PathChunk<Sink>::found(int i, int k, const Vec3& direction, const Vec3& radiance, float t, uint32_t primitive) {
  const PathTracer::Impl::LightInfo& l = m.lights[k];
  float weight = 1.0f;
  if (paths.pdf[i] > 0.0f) {
    const Vec3 from = paths.from.get(i), normal = paths.fromNormal.get(i);
    const float select = m.selector.probability(from, paths.fromHasNormal >> i & 1u ? &normal : nullptr, k);
    weight = powerHeuristic(paths.pdf[i], select * m.sampler->pdf(l.light, from, direction, t + paths.passed[i], primitive, radiance));
  }
  Vec3 value = paths.throughput.get(i) * radiance * l.nominal * weight;
  if (hasMedia) value *= media.through(i, t);
  contribute(i, l.slot, done(i), classAt(i), value, specularOf(i, value));
}

/// Rect, disk and sphere lights along a piece of lane i's ray.
template <PathSink Sink>
inline void PathChunk<Sink>::collectAreaLights(int i, const Vec3& origin, const Vec3& direction, float tmax) {
  const Ray ray{origin, direction, 0.0f, tmax};
  const bool visibleOnly = paths.fromCamera >> i & 1u;
  const auto meets = [&](int k, float t, const Vec3& ng) { found(i, k, direction, m.sampler->emitted(m.lights[k].light, direction, 0, 0, 0, ng), t, 0); };
  if (m.areaLights.size() >= m.areaBvhFrom) {
    static thread_local std::vector<AreaLightBvh::Hit> hits;
    m.areaBvh.collect(ray, visibleOnly, hits);
    for (const AreaLightBvh::Hit& h : hits) meets(h.light, h.t, h.Ng);
    return;
  }
  for (size_t a = 0; a < m.areaLights.size(); ++a) {
    const Vec3 oc = Vec3(m.areaX[a], m.areaY[a], m.areaZ[a]) - origin;
    const Vec3 across = oc - direction * glm::dot(oc, direction);
    if (glm::dot(across, across) > m.areaRadius2[a] + 1e-10f * glm::dot(oc, oc)) continue;  // bounding sphere, with room for float
    const int k = m.areaLights[a];
    if (visibleOnly && !m.lights[k].seenByCamera) continue;
    float t;
    Vec3 ng;
    if (intersectAreaLight(m.areaShapes[a], ray, t, ng)) meets(k, t, ng);
  }
}

/// Reads alive, rh, paths, media; writes lambert and general, the vertex of plain Lambert lanes in ls, throughput (what a volume left);
/// clears shadowed and next. Plain Lambert lanes are only gathered by the loop: their vertex is made 8 at a time.
template <PathSink Sink>
inline void PathChunk<Sink>::meetLights() {
  uint32_t plain = 0, smooth = 0;
  lambert = general = shadowed = next = 0;
  for (uint32_t left = alive; left; left &= left - 1) {
    const int i = __builtin_ctz(left);
    const uint32_t bit = 1u << i;
    const bool hit = rh.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID;
    const bool collects = wanted(classAt(i));
    if (collects && !m.areaLights.empty() && !(hasMedia && media.walking >> i & 1u))
      collectAreaLights(i, rayOrigin(rh.ray, i), rayDirection(rh.ray, i), rh.ray.tfar[i]);  // without a hit: as far as the ray sees
    if (!hit) {
      if (collects)
        for (int k : m.environments) {
          if (paths.fromCamera >> i & 1u && !m.lights[k].seenByCamera) continue;
          const Vec3 radiance = m.sampler->emitted(m.lights[k].light, rayDirection(rh.ray, i), 0, 0, 0, Vec3(0.0f));
          if (maxComponent(radiance) > 0.0f) found(i, k, rayDirection(rh.ray, i), radiance, 3.0e38f, 0);
        }
      vertex(i, VertexKind::Escape, done(i) + 1, rayDirection(rh.ray, i), Vec3(0.0f));
      continue;
    }
    const uint32_t instance = hitInstance(rh.hit, i);
    const uint32_t primitive = rh.hit.primID[i];
    if (const int k = m.meshLight[instance]; k >= 0 && collects) {
      const Vec3 d = rayDirection(rh.ray, i);
      const Vec3 radiance = m.sampler->emitted(m.lights[k].light, d, primitive, rh.hit.u[i], rh.hit.v[i], Vec3(0.0f));
      if (maxComponent(radiance) > 0.0f) found(i, k, d, radiance, rh.ray.tfar[i], primitive);
    }
    if (hasMedia && media.stack[i].depth > 0) paths.throughput.set(i, paths.throughput.get(i) * media.through(i, rh.ray.tfar[i]));
    const SurfaceInstance& s = m.surfaces.instance(instance);
    if (s.unlit) {
      if (collects && m.settings.unlit && paths.specularOnly >> i & 1u) {
        Surface shown;
        m.surfaces.interact(instance, primitive, rh.hit.u[i], rh.hit.v[i], Vec3(0, 1, 0), rayDirection(rh.ray, i), shown);
        const Vec3 value = paths.throughput.get(i) * shown.bsdf.albedo;
        contribute(i, 0, done(i), classAt(i), value, specularOf(i, value));
      }
      endsAtHit(i);
      continue;
    }
    if (done(i) >= m.maxEvents && !(straight && (s.material->straight || s.material->interior >= 0))) {
      endsAtHit(i);
      continue;
    }
    if (!s.plainLambert) {
      m.surfaces.prefetchTriangle(instance, primitive);
      general |= bit;
      continue;
    }
    const uint32_t* tri = s.indices + 3 * size_t(primitive);
    ls.a.set(i, s.positions[tri[0]]);
    ls.b.set(i, s.positions[tri[1]]);
    ls.c.set(i, s.positions[tri[2]]);
    ls.albedo.set(i, s.material->constant.albedo);
    plain |= bit;
    if (!s.normals) continue;
    ls.n.set(i, SurfaceTable::vertexNormal(s, tri, rh.hit.u[i], rh.hit.v[i]));
    smooth |= bit;
  }
  for (int h = 0; h < kLanes; h += 8) {
    if (!(plain >> h & 255u)) continue;
    lambert |= lanes::plainSurface(ls, h, plain >> h & 255u, smooth >> h & 255u, rh.hit.u, rh.hit.v, rh.hit.Ng_x, rh.hit.Ng_y, rh.hit.Ng_z, rh.ray.dir_x,
                                   rh.ray.dir_y, rh.ray.dir_z)
               << h;
  }
  general |= plain & ~lambert;
}

}  // namespace trace
}  // namespace gobo

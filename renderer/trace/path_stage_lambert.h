// SPDX-License-Identifier: Apache-2.0
// Stage: Lambert surfaces, 8 lanes at a time (lambert_lanes.h).
#pragma once

#include "trace/path_chunk.h"

namespace gobo {
inline namespace trace {

/// Next-event estimation of the lanes in `asking`. Writes shadowed with sr, lit, litSpecular, litSlot, litEvent.
template <PathSink Sink>
inline void PathChunk<Sink>::askAtLambert(uint32_t asking) {
  // Lane i asks for light k by the sample that it drew, which was chosen with probability `select`.
  const auto ask = [&](int i, int k, const LightSample& light, float select) {
    const Vec3 p = ls.p.get(i);
    const float cosine = glm::dot(light.direction, ls.n.get(i));
    if (!(cosine > 0.0f) || !(glm::dot(light.direction, ls.facing.get(i)) > 0.0f)) return;
    const float f = kInvPi * cosine, lightPdf = light.pdf * select;
    const float weight = light.delta ? 1.0f : powerHeuristic(lightPdf, f);
    const Vec3 value = paths.throughput.get(i) * ls.albedo.get(i) * light.radiance * m.lights[k].nominal * (f * weight / lightPdf);
    if (!(maxComponent(value) > 0.0f) && isFinite(value)) return;
    aimShadowRay(sr, i, p, ls.origin.get(i), light);
    lit.set(i, value);
    if (lobes) litSpecular.set(i, done(i) == 0 ? Vec3(0.0f) : value * paths.specularPart.get(i));
    litSlot[i] = m.lights[k].slot;
    litEvent[i] = done(i) + 1;
    if (hasMedia) media.startShadow(i);
    shadowed |= 1u << i;
  };
  if (m.hasPlainLight) {
    for (uint32_t left = asking; left; left &= left - 1) {
      const int i = __builtin_ctz(left);
      const Vec3 p = ls.p.get(i);
      const PlainMeshLight::Triangle& t = m.plainLight.pick(choice[i], p, lamp.area[i]);
      if (nearTriangle(p, t.p, t.e1, t.e2)) {
        if (const SphericalTriangle near(p, t.p, t.e1, t.e2); near.valid()) {
          asking &= ~(1u << i);
          LightSample light;
          if (m.plainLight.sampleNear(t, near, lamp.area[i], Vec2(ux[i], uy[i]), light)) ask(i, m.plainLightIndex, light, 1.0f);
          continue;
        }
      }
      lamp.p.set(i, t.p);
      lamp.e1.set(i, t.e1);
      lamp.e2.set(i, t.e2);
      lamp.n.set(i, t.n);
    }
    const PathTracer::Impl::LightInfo& l = m.lights[m.plainLightIndex];
    uint32_t free = 0;
    for (int h = 0; h < kLanes; h += 8)
      if (asking >> h & 255u)
        free |= lanes::sampleLight(ls, paths.throughput, lamp, m.plainLight.doubleSided, l.nominal, h, asking >> h & 255u, ux, uy, shadowX, shadowY, shadowZ,
                                   shadowReach, litPlain)
                << h;
    for (uint32_t left = free; left; left &= left - 1) {
      const int i = __builtin_ctz(left);
      putShadowRay(sr, i, ls.origin.get(i), Vec3(shadowX[i], shadowY[i], shadowZ[i]), shadowReach[i]);
      lit.set(i, litPlain.get(i));
      if (lobes) litSpecular.set(i, done(i) == 0 ? Vec3(0.0f) : lit.get(i) * paths.specularPart.get(i));
      litSlot[i] = l.slot;
      litEvent[i] = done(i) + 1;
      if (hasMedia) media.startShadow(i);
    }
    shadowed |= free;
  } else {
    for (uint32_t left = asking; left; left &= left - 1) {
      const int i = __builtin_ctz(left);
      const Vec3 p = ls.p.get(i), n = ls.n.get(i);
      float select;
      const int k = m.selector.sample(p, &n, choice[i], select);
      LightSample light;
      if (k < 0 || !m.sampler->sample(m.lights[k].light, p, Vec2(ux[i], uy[i]), light)) continue;
      ask(i, k, light, select);
    }
  }
}

/// Reads lambert, ls, the event's numbers; writes next, and the state of lanes that go on.
template <PathSink Sink>
inline void PathChunk<Sink>::scatterAtLambert() {
  if constexpr (Sink::kVertices)
    for (uint32_t left = lambert; left; left &= left - 1) {
      const int i = __builtin_ctz(left);
      vertex(i, VertexKind::Surface, done(i) + 1, ls.p.get(i), ls.n.get(i));
    }
  uint32_t asking = lambert, bouncing = lambert;
  if (freePasses)
    for (uint32_t left = lambert; left; left &= left - 1) {
      const int i = __builtin_ctz(left);
      const uint32_t bit = 1u << i;
      if (!asks(i)) asking &= ~bit;
      if (done(i) + 1 >= m.maxEvents && !m.hittable && !hasMedia) bouncing &= ~bit;
      if (m.settings.behindOnly && done(i) == 0) {
        lambert &= ~bit;
        asking &= ~bit;
        bouncing &= ~bit;
      }
    }
  else if (m.settings.behindOnly && events == 0) lambert = asking = bouncing = 0;
  for (int h = 0; h < kLanes; h += 8)
    if (lambert >> h & 255u) lanes::moveOrigins(ls, h);
  if (nee && asking != 0) askAtLambert(asking);
  if (goesOn && bouncing != 0) {
    uint32_t on = 0;
    for (int h = 0; h < kLanes; h += 8)
      if (bouncing >> h & 255u)
        on |= lanes::bounce(ls, h, bouncing >> h & 255u, vx, vy, vz, rouletteOn ? roulette : nullptr, paths.throughput, rh.ray.dir_x, rh.ray.dir_y,
                            rh.ray.dir_z, paths.pdf)
              << h;
    for (int i = 0; i < kLanes; ++i) {
      const bool mine = bouncing >> i & 1u;
      rh.ray.org_x[i] = mine ? ls.origin.x[i] : rh.ray.org_x[i];
      rh.ray.org_y[i] = mine ? ls.origin.y[i] : rh.ray.org_y[i];
      rh.ray.org_z[i] = mine ? ls.origin.z[i] : rh.ray.org_z[i];
      paths.from.x[i] = mine ? ls.p.x[i] : paths.from.x[i];
      paths.from.y[i] = mine ? ls.p.y[i] : paths.from.y[i];
      paths.from.z[i] = mine ? ls.p.z[i] : paths.from.z[i];
      paths.fromNormal.x[i] = mine ? ls.n.x[i] : paths.fromNormal.x[i];
      paths.fromNormal.y[i] = mine ? ls.n.y[i] : paths.fromNormal.y[i];
      paths.fromNormal.z[i] = mine ? ls.n.z[i] : paths.fromNormal.z[i];
      paths.passed[i] = mine ? 0.0f : paths.passed[i];
    }
    paths.fromHasNormal |= bouncing;
    paths.specularOnly &= ~bouncing;
    paths.fromCamera &= ~bouncing;
    next |= on;
    if constexpr (Sink::kVertices)
      for (uint32_t left = on; left; left &= left - 1) {
        const int i = __builtin_ctz(left);
        scatter(i, rayDirection(rh.ray, i), ls.albedo.get(i), Vec3(0.0f), paths.pdf[i], false, false);
      }
  }
}

}  // namespace trace
}  // namespace gobo

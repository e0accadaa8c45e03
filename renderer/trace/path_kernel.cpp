// SPDX-License-Identifier: Apache-2.0
#include "trace/path_kernel.h"

#include <cstring>

#include "trace/area_lights.h"
#include "trace/lambert_lanes.h"
#include "trace/path_media.h"
#include "trace/path_sums.h"
#include "trace/reach.h"
#include "trace/spherical_triangle.h"
#include "trace/straight.h"

namespace gobo {

namespace {

// Draws of one scattering event: the light's point, the new direction, (which light, which lobe), roulette.
enum Draw : uint32_t { kDrawLight = 0, kDrawDirection = 1, kDrawChoice = 2, kDrawRoulette = 3, kDrawsPerEvent = 4 };

// Path state by lane. Lanes never move: Embree masks the dead ones, and vector code computes them along.
struct Paths {
  Lane3 throughput;
  Lane3 specularPart;             // share of the first event's specular lobe in the throughput (ByLobe)
  Lane3 from, fromNormal;         // the last vertex, as the light selector saw it
  alignas(64) float pdf[kLanes];  // density of the ray's direction; 0 after the camera or a delta event: nothing else finds its light
  float passed[kLanes] = {};      // way from the last vertex to the ray's origin: surfaces passed straight on are no vertices
  int free[kLanes] = {};          // passes of the loop that were no scattering event of their own (path_media.h, straight.h)
  // Bit per lane. firstDelta: reaches light by an indirect path, whatever the number of events. specularOnly: delta events, if any.
  // fromCamera: the camera still looks straight on, so that lights hidden from it (trace/reach.h) and back faces that it culls are passed;
  // no question of the density.
  uint32_t fromHasNormal = 0, firstDelta = 0, specularOnly = ~0u, fromCamera = ~0u;
};

inline Vec3 direction(const RTCRay16& r, int i) { return Vec3(r.dir_x[i], r.dir_y[i], r.dir_z[i]); }

inline void putShadow(RTCRay16& r, int i, const Vec3& origin, const Vec3& aim, float reach) {
  r.org_x[i] = origin.x;
  r.org_y[i] = origin.y;
  r.org_z[i] = origin.z;
  r.dir_x[i] = aim.x;
  r.dir_y[i] = aim.y;
  r.dir_z[i] = aim.z;
  r.tfar[i] = reach;
}
// From the moved origin to the same point of the light; t counts in units of that way. It ends short of the light by what
// rounding may have put between the sampled point and the light's own surface.
inline void aimShadow(RTCRay16& r, int i, const Vec3& p, const Vec3& origin, const LightSample& light) {
  if (light.distance >= 3.0e38f) {
    putShadow(r, i, origin, light.direction, 3.0e38f);
    return;
  }
  const float slack = 3e-6f * std::max(std::fabs(p.x), std::max(std::fabs(p.y), std::fabs(p.z)));
  putShadow(r, i, origin, (p - origin) + light.direction * light.distance, std::max(0.0f, 1.0f - 2e-5f - slack / light.distance));
}

void record(uint32_t lanes, const RTCRay16& r, std::vector<Ray>& to) {
  for (; lanes; lanes &= lanes - 1) {
    const int i = __builtin_ctz(lanes);
    to.push_back({Vec3(r.org_x[i], r.org_y[i], r.org_z[i]), direction(r, i), r.tnear[i], r.tfar[i]});
  }
}

}  // namespace

void PathTracer::Impl::traceChunk(int x, int y, const SampleSet& set, uint64_t film, int count, double* out, uint64_t& rays, uint64_t& dropped) const {
  Accumulator sums(slotCount == 1, recordBuffer());
  Paths paths;
  RTCRayHit16 rh;  // the rays live here
  RTCRay16 sr;     // at most one shadow ray a lane and event
  LaneSurface ls;
  lanes::LightLanes lamp;
  Lane3 lit, litSpecular;  // what a free shadow ray adds
  int litSlot[kLanes];
  Lane3 litPlain;
  alignas(64) float shadowX[kLanes], shadowY[kLanes], shadowZ[kLanes], shadowReach[kLanes];
  alignas(64) float ux[kLanes], uy[kLanes], px[kLanes], py[kLanes], vx[kLanes], vy[kLanes], vz[kLanes];
  alignas(64) float choice[kLanes], lobe[kLanes], roulette[kLanes];
  alignas(64) int valid[kLanes];
  const SplitMode split = settings.split;
  const bool byLobe = split == SplitMode::ByLobe;
  const bool hasMedia = !surfaces.interiors().empty();
  // Light goes straight on through some surfaces. Shadow rays see through them, so the path's own rays keep the density that they
  // had at their last vertex: beyond the surface both strategies find the same light.
  const bool straight = surfaces.anyStraight();
  const bool freePasses = hasMedia || straight;
  PathMedia media;
  if (hasMedia) media.start(surfaces.interiors(), cameraMedia);

  const auto classOf = [](int events, bool firstDelta) {
    return events == 0 ? PathClass::Emission : events == 1 && !firstDelta ? PathClass::Direct : PathClass::Indirect;
  };
  const auto wanted = [&](PathClass c) { return has(settings.cover, c); };
  // Adds light that arrived after `events` scattering events; `specular` is the part by the first event's specular lobe.
  const auto add = [&](int lane, int slot, int events, PathClass c, const Vec3& value, const Vec3& specular) {
    switch (split) {
      case SplitMode::Combined: sums.add(lane, slot, value); return;
      case SplitMode::DirectIndirect: sums.add(lane, slot + (c == PathClass::Emission ? 0 : c == PathClass::Direct ? 1 : 2), value); return;
      case SplitMode::ByBounce: sums.add(lane, slot + events, value); return;
      case SplitMode::ByLobe:
        if (c == PathClass::Emission) {
          sums.add(lane, slot, value);
          return;
        }
        const int base = slot + (c == PathClass::Direct ? 1 : 3);
        sums.add(lane, base, value - specular);
        sums.add(lane, base + 1, specular);
        return;
    }
  };
  // The ray of lane i found light k, which sends `radiance` (for power 1) along it; `t`, `primitive` as LightSampler::pdf wants them.
  const auto found = [&](int i, int k, int events, const Vec3& direction, const Vec3& radiance, float t, uint32_t primitive) {
    const LightInfo& l = lights[k];
    float weight = 1.0f;
    if (paths.pdf[i] > 0.0f) {
      const Vec3 from = paths.from.get(i), normal = paths.fromNormal.get(i);
      const float select = selector.probability(from, paths.fromHasNormal >> i & 1u ? &normal : nullptr, k);
      weight = powerHeuristic(paths.pdf[i], select * sampler->pdf(l.light, from, direction, t + paths.passed[i], primitive));
    }
    Vec3 value = paths.throughput.get(i) * radiance * l.nominal * weight;
    if (hasMedia) value *= media.through(i, t);
    add(i, l.slot, events, classOf(events, paths.firstDelta >> i & 1u), value, byLobe ? value * paths.specularPart.get(i) : Vec3(0.0f));
  };
  const auto collectAreaLights = [&](int i, int events, const Vec3& origin, const Vec3& direction, float tmax) {
    const Ray ray{origin, direction, 0.0f, tmax};
    const bool visibleOnly = paths.fromCamera >> i & 1u;
    const auto meets = [&](int k, float t, const Vec3& ng) { found(i, k, events, direction, sampler->emitted(lights[k].light, direction, 0, 0, 0, ng), t, 0); };
    if (areaLights.size() >= areaBvhFrom) {
      static thread_local std::vector<AreaLightBvh::Hit> hits;
      areaBvh.collect(ray, visibleOnly, hits);
      for (const AreaLightBvh::Hit& h : hits) meets(h.light, h.t, h.Ng);
      return;
    }
    for (size_t a = 0; a < areaLights.size(); ++a) {
      const Vec3 oc = Vec3(areaX[a], areaY[a], areaZ[a]) - origin;
      const Vec3 across = oc - direction * glm::dot(oc, direction);
      if (glm::dot(across, across) > areaRadius2[a] + 1e-10f * glm::dot(oc, oc)) continue;  // bounding sphere, with room for float
      const int k = areaLights[a];
      if (visibleOnly && !lights[k].seenByCamera) continue;
      float t;
      Vec3 ng;
      if (intersectAreaLight(areaShapes[a], ray, t, ng)) meets(k, t, ng);
    }
  };

  // A lane met a scattering event inside a volume: one event where it is the path's first, and never direct light.
  const auto walked = [&](int i, int events, uint32_t bit) {
    if (events == paths.free[i] || media.strayed & bit) --paths.free[i];
    media.strayed &= ~bit;
    paths.firstDelta |= bit;
    paths.specularOnly &= ~bit;
    paths.fromCamera &= ~bit;
    paths.pdf[i] = 0.0f;
  };

  // Camera rays. Lanes beyond `count` repeat lane 0, masked out: their numbers stay ordinary.
  if (viewSamples.empty()) set.draw2D(0, px, py);
  for (int i = 0; i < kLanes; ++i) {
    Vec2 offset;
    if (viewSamples.empty()) offset = Vec2(px[i], py[i]);
    else offset = viewSamples[size_t((film + uint64_t(i)) % viewSamples.size())];
    const float fx = float(x) + offset.x, fy = float(y) + offset.y;
    const Vec3 o = cameraOrigin + cameraOriginX * fx + cameraOriginY * fy;
    Vec3 d = cameraDirection + cameraDirectionX * fx + cameraDirectionY * fy;
    d *= 1.0f / std::sqrt(glm::dot(d, d));
    rh.ray.org_x[i] = o.x;
    rh.ray.org_y[i] = o.y;
    rh.ray.org_z[i] = o.z;
    rh.ray.dir_x[i] = d.x;
    rh.ray.dir_y[i] = d.y;
    rh.ray.dir_z[i] = d.z;
    rh.ray.tnear[i] = 0.0f;
    rh.ray.time[i] = 0.0f;
    rh.ray.mask[i] = ~0u;
    rh.ray.id[i] = 0;
    rh.ray.flags[i] = 0;
    sr.tnear[i] = 0.0f;
    sr.time[i] = 0.0f;
    sr.mask[i] = ~0u;
    sr.id[i] = 0;
    sr.flags[i] = 0;
    paths.throughput.set(i, Vec3(1.0f));
    paths.specularPart.set(i, Vec3(0.0f));
    paths.pdf[i] = 0.0f;
  }
  std::memset(static_cast<void*>(&ls), 0, sizeof ls);
  std::memset(static_cast<void*>(&lamp), 0, sizeof lamp);
  std::memset(static_cast<void*>(&rh.hit), 0, sizeof rh.hit);

  const Accel::Impl& geometry = accel->impl();
  embree::Context context;
  embree::initContext(context);
  const bool culls = passed.any();
  BackFaces::Context cameraContext;
  if (culls) passed.init(cameraContext);
  uint32_t alive = count >= 32 ? ~0u : (1u << count) - 1;
  for (int events = 0; alive != 0; ++events) {
    for (int i = 0; i < kLanes; ++i) {
      valid[i] = alive >> i & 1u ? -1 : 0;
      rh.ray.tfar[i] = 3.0e38f;
      rh.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
      rh.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
    }
    if (culls && (alive & paths.fromCamera) != 0) {
      for (int i = 0; i < kLanes; ++i) rh.ray.id[i] = paths.fromCamera >> i & 1u ? BackFaces::kPasses : 0;
      embree::intersect16(valid, scene, cameraContext.context, rh, events == 0, BackFaces::filter);
    } else {
      embree::intersect16(valid, scene, context, rh, events == 0);
    }
    rays += uint64_t(__builtin_popcount(alive));
    if (recorder) record(alive, rh.ray, events == 0 ? recorder->primary : recorder->bounce);

    const auto done = [&](int i) { return events - paths.free[i]; };                    // scattering events that lane i has behind it
    const auto asks = [&](int i) { return done(i) == 0 ? wantDirect : wantIndirect; };  // for light at its next event
    const bool nee = (events == 0 ? wantDirect : wantIndirect || (freePasses && wantDirect)) && selector.count() > 0;
    const bool rouletteOn = events + 1 >= settings.rouletteStart;
    if (events < maxEvents || freePasses) {
      const uint32_t base = 1 + uint32_t(events) * kDrawsPerEvent;
      if (nee) set.draw2D(base + kDrawLight, ux, uy);
      set.draw2D(base + kDrawDirection, px, py);
      cosineDirections(px, py, vx, vy, vz);
      if (drawsChoice) set.draw2D(base + kDrawChoice, choice, lobe);
      if (rouletteOn) set.draw1D(base + kDrawRoulette, roulette);
    }

    if (hasMedia) {  // lanes inside something that scatters walk to the end of their last segment
      media.walking = 0;
      for (uint32_t left = alive; left; left &= left - 1) {
        const int i = __builtin_ctz(left);
        const uint32_t bit = 1u << i;
        const Interior* inside = media.around(i);
        if (!inside || !inside->scatters) continue;
        media.walking |= bit;
        bool scattered = false;
        const auto collect = [&](const Vec3& o, const Vec3& d, float t) {
          if (!areaLights.empty() && done(i) <= maxEvents && wanted(classOf(done(i), paths.firstDelta >> i & 1u))) collectAreaLights(i, done(i), o, d, t);
        };
        const auto scatter = [&](const Vec3& p, const Vec3& d, const Vec3& departing, const Vec3& beta, uint64_t draw) {
          walked(i, events, bit);
          if (!wantIndirect || done(i) > maxEvents || !mediaLights[size_t(media.stack[i].top())]) return;
          int slot;
          const Vec3 value = scatteredLight(media, i, p, d, beta, draw, slot, rays);
          if (value != Vec3(0.0f)) add(i, slot, done(i), PathClass::Indirect, value, byLobe ? value * paths.specularPart.get(i) : Vec3(0.0f));
          paths.pdf[i] = henyeyGreenstein(glm::dot(d, departing), inside->g);
          paths.from.set(i, p);
          paths.fromHasNormal &= ~bit;
          paths.passed[i] = 0.0f;
        };
        const uint64_t key = hash64(hash64(set.seed(), film + uint64_t(i)), 0x77616c6bull << 32 | uint32_t(events));
        if (!media.walk(i, rh, scene, paths.throughput, key, rays, scattered, collect, scatter) || (scattered && (!wantIndirect || done(i) > maxEvents)))
          alive &= ~bit;
        media.strayed &= ~bit;
      }
    }

    // What each ray met: lights, then the surface. Flat Lambert lanes are only gathered here.
    uint32_t flat = 0, lambert = 0, general = 0, shadowed = 0, next = 0;
    for (uint32_t left = alive; left; left &= left - 1) {
      const int i = __builtin_ctz(left);
      const uint32_t bit = 1u << i;
      const bool hit = rh.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID;
      const bool collects = wanted(classOf(done(i), paths.firstDelta >> i & 1u));
      if (collects && !areaLights.empty() && !(hasMedia && media.walking >> i & 1u))
        collectAreaLights(i, done(i), Vec3(rh.ray.org_x[i], rh.ray.org_y[i], rh.ray.org_z[i]), direction(rh.ray, i), hit ? rh.ray.tfar[i] : 3.0e38f);
      if (!hit) {
        if (collects)
          for (int k : environments) {
            if (paths.fromCamera >> i & 1u && !lights[k].seenByCamera) continue;
            const Vec3 radiance = sampler->emitted(lights[k].light, direction(rh.ray, i), 0, 0, 0, Vec3(0.0f));
            if (maxComponent(radiance) > 0.0f) found(i, k, done(i), direction(rh.ray, i), radiance, 3.0e38f, 0);
          }
        continue;
      }
      const uint32_t instance = rh.hit.instID[0][i] == RTC_INVALID_GEOMETRY_ID ? rh.hit.geomID[i] : rh.hit.instID[0][i];
      const uint32_t primitive = rh.hit.primID[i];
      if (const int k = meshLight[instance]; k >= 0 && collects) {
        const Vec3 d = direction(rh.ray, i);
        const Vec3 radiance = sampler->emitted(lights[k].light, d, primitive, rh.hit.u[i], rh.hit.v[i], Vec3(0.0f));
        if (maxComponent(radiance) > 0.0f) found(i, k, done(i), d, radiance, rh.ray.tfar[i], primitive);
      }
      if (hasMedia && media.stack[i].depth > 0) paths.throughput.set(i, paths.throughput.get(i) * media.through(i, rh.ray.tfar[i]));
      const SurfaceInstance& s = surfaces.instance(instance);
      if (s.unlit) {
        if (collects && settings.unlit && paths.specularOnly >> i & 1u) {
          Surface shown;
          surfaces.interact(instance, primitive, rh.hit.u[i], rh.hit.v[i], Vec3(0, 1, 0), direction(rh.ray, i), shown);
          const Vec3 value = paths.throughput.get(i) * shown.bsdf.albedo;
          add(i, 0, done(i), classOf(done(i), paths.firstDelta >> i & 1u), value, byLobe ? value * paths.specularPart.get(i) : Vec3(0.0f));
        }
        continue;
      }
      if (done(i) >= maxEvents && !(straight && (s.material->straight || s.material->interior >= 0))) continue;
      if (!s.flatLambert) {
        general |= bit;
        continue;
      }
      const uint32_t* tri = s.indices + 3 * size_t(primitive);
      ls.a.set(i, s.positions[tri[0]]);
      ls.b.set(i, s.positions[tri[1]]);
      ls.c.set(i, s.positions[tri[2]]);
      ls.albedo.set(i, s.material->constant.albedo);
      flat |= bit;
    }
    for (int h = 0; h < kLanes; h += 8)
      if (flat >> h & 255u)
        lambert |=
            lanes::flatSurface(ls, h, flat >> h & 255u, rh.hit.u, rh.hit.v, rh.hit.Ng_x, rh.hit.Ng_y, rh.hit.Ng_z, rh.ray.dir_x, rh.ray.dir_y, rh.ray.dir_z)
            << h;
    general |= flat & ~lambert;

    // Everything else: the full surface. Smooth or textured Lambert joins the vector code, other materials are finished here.
    const bool goesOn = events + 1 < maxEvents || hittable || freePasses;  // after the last event a ray can only find light
    for (uint32_t left = general; left; left &= left - 1) {
      const int i = __builtin_ctz(left);
      const uint32_t bit = 1u << i;
      const uint32_t instance = rh.hit.instID[0][i] == RTC_INVALID_GEOMETRY_ID ? rh.hit.geomID[i] : rh.hit.instID[0][i];
      const Vec3 Ng = geometry.worldNormal(instance, Vec3(rh.hit.Ng_x[i], rh.hit.Ng_y[i], rh.hit.Ng_z[i]));
      const Vec3 d = direction(rh.ray, i);
      Surface s;
      surfaces.interact(instance, rh.hit.primID[i], rh.hit.u[i], rh.hit.v[i], Ng, d, s);
      const Vec3 facing = s.facing();
      const int volume = s.material->interior;
      if (volume >= 0) {
        if (media.passes(i, volume, s.front)) {
          const Vec3 o = s.origin(-facing);
          rh.ray.org_x[i] = o.x;
          rh.ray.org_y[i] = o.y;
          rh.ray.org_z[i] = o.z;
          media.cross(i, volume, s.front);
          if (straight) paths.passed[i] += rh.ray.tfar[i];
          else paths.pdf[i] = 0.0f;  // shadow rays stop here: nothing else finds the light beyond
          ++paths.free[i];
          if (paths.free[i] < kMostFree) next |= bit;
          continue;
        }
        if (s.material->dispersion > 0.0f) {  // one channel goes on, for all three; stratified over the samples of a pixel
          if (media.hero[i] < 0) {
            media.hero[i] = int8_t((film + uint64_t(i) + hash64(set.seed(), 0x64697370u) % 3) % 3);
            Vec3 one(0.0f);
            one[media.hero[i]] = 3.0f * paths.throughput.get(i)[media.hero[i]];
            paths.throughput.set(i, one);
          }
          s.bsdf.ior = dispersedIor(s.bsdf.ior, s.material->dispersion, media.hero[i]);
        }
        s.bsdf.ior = media.relativeIor(i, volume, s.bsdf.ior, s.front);
      }
      const int event = done(i) + 1;
      // What the camera sees first is an event, whatever it does: G-buffer and classes begin there.
      const bool mayPass = straight && event > 1 && (s.material->straight || volume >= 0) && bendsAlike(*s.material);
      const auto passOn = [&](const Vec3& carried) {
        const Vec3 o = s.origin(-facing);
        rh.ray.org_x[i] = o.x;
        rh.ray.org_y[i] = o.y;
        rh.ray.org_z[i] = o.z;
        if (volume >= 0) {
          media.cross(i, volume, s.front);
          if (const Interior* inside = media.around(i); inside && inside->scatters) media.strayed |= bit;
        }
        paths.throughput.set(i, carried);
        paths.passed[i] += rh.ray.tfar[i];
        if (++paths.free[i] < kMostFree) next |= bit;
      };
      if (event > maxEvents) {  // no event is left, but light beyond what bends nothing
        const Vec3 left = mayPass && hittable ? bsdfStraight(s.bsdf, s.frame().toLocal(-d)) : Vec3(0.0f);
        if (maxComponent(left) > 0.0f) passOn(paths.throughput.get(i) * left);
        continue;
      }
      if (s.lambert) {
        ls.p.set(i, s.p);
        ls.reach.set(i, s.reach);
        ls.facing.set(i, facing);
        ls.n.set(i, s.n);
        ls.albedo.set(i, s.bsdf.albedo);
        lambert |= bit;
        continue;
      }
      const Frame frame = s.frame();
      const Vec3 wo = frame.toLocal(-d), throughput = paths.throughput.get(i);
      const bool delta = bsdfIsDelta(s.bsdf), hasNormal = !s.material->transmissive;
      if (nee && !delta && asks(i)) {
        float select;
        const int k = selector.sample(s.p, hasNormal ? &s.n : nullptr, choice[i], select);
        LightSample light;
        if (k >= 0 && sampler->sample(lights[k].light, s.p, Vec2(ux[i], uy[i]), light)) {
          const float cosine = glm::dot(light.direction, s.n), side = glm::dot(light.direction, facing);
          if (cosine * side > 0.0f && (cosine > 0.0f || !hasNormal) && (side < 0.0f || !(settings.behindOnly && event == 1))) {
            const Vec3 wi = frame.toLocal(light.direction);
            float scatterPdf;
            const BsdfValue f = bsdfEvalPdf(s.bsdf, wo, wi, scatterPdf);
            const float lightPdf = light.pdf * select;
            const float weight = light.delta ? 1.0f : powerHeuristic(lightPdf, scatterPdf);
            const Vec3 arriving = throughput * light.radiance * lights[k].nominal * (weight / lightPdf);
            const Vec3 value = arriving * f.sum();
            if (maxComponent(value) > 0.0f || !isFinite(value)) {
              aimShadow(sr, i, s.p, s.origin(side > 0.0f ? facing : -facing), light);
              lit.set(i, value);
              if (byLobe) litSpecular.set(i, event == 1 ? arriving * f.specular : value * paths.specularPart.get(i));
              litSlot[i] = lights[k].slot;
              if (hasMedia) {
                if (side > 0.0f || volume < 0) media.startShadow(i);
                else media.startShadowBehind(i, volume, s.front);
              }
              shadowed |= bit;
            }
          }
        }
      }
      BsdfSample bs;
      if (!goesOn || (event == 1 && delta && !wantIndirect)) continue;
      if (!bsdfSample(s.bsdf, wo, lobe[i], Vec2(px[i], py[i]), bs)) continue;
      if (event == 1) {
        if (bs.delta && !wantIndirect) continue;
        if (bs.delta) paths.firstDelta |= bit;
        if (byLobe) {
          Vec3 part(1.0f);
          if (!bs.delta) {
            const BsdfValue f = bsdfEval(s.bsdf, wo, bs.wi);
            const Vec3 all = f.sum();
            for (int c = 0; c < 3; ++c) part[c] = all[c] > 0.0f ? f.specular[c] / all[c] : 0.0f;
          }
          paths.specularPart.set(i, part);
        }
      }
      Vec3 wi = frame.toWorld(bs.wi);
      wi *= 1.0f / std::sqrt(glm::dot(wi, wi));
      const float side = glm::dot(wi, facing);
      if (bs.transmitted ? !(side < 0.0f) : !(side > 0.0f) || (settings.behindOnly && event == 1)) continue;
      Vec3 carried = throughput * bs.weight;
      const float most = maxComponent(carried);
      if (!isFinite(carried)) {
        sums.bad |= bit;
        continue;
      }
      if (!(most > 0.0f)) continue;
      if (mayPass && bs.straight) {
        passOn(carried);
        continue;
      }
      if (rouletteOn) {
        const float survive = std::min(0.95f, std::sqrt(most));  // see path_tracer.h
        if (roulette[i] >= survive) continue;
        carried *= 1.0f / survive;
      }
      const Vec3 o = s.origin(side > 0.0f ? facing : -facing);
      rh.ray.org_x[i] = o.x;
      rh.ray.org_y[i] = o.y;
      rh.ray.org_z[i] = o.z;
      rh.ray.dir_x[i] = wi.x;
      rh.ray.dir_y[i] = wi.y;
      rh.ray.dir_z[i] = wi.z;
      if (volume >= 0) {
        const Interior* inside = media.around(i);
        if (bs.transmitted) media.cross(i, volume, s.front);
        else if (!s.front && inside && inside->scatters && media.stack[i].top() == volume && paths.free[i] < kMostFree) ++paths.free[i];  // still the same walk
      }
      if (!bs.delta) paths.specularOnly &= ~bit;
      if (!bs.straight) paths.fromCamera &= ~bit;
      paths.throughput.set(i, carried);
      paths.pdf[i] = bs.delta ? 0.0f : bs.pdf;
      paths.passed[i] = 0.0f;
      paths.from.set(i, s.p);
      paths.fromNormal.set(i, s.n);
      paths.fromHasNormal = hasNormal ? paths.fromHasNormal | bit : paths.fromHasNormal & ~bit;
      next |= bit;
    }

    // Lambert lanes.
    uint32_t asking = lambert, bouncing = lambert;
    if (freePasses)
      for (uint32_t left = lambert; left; left &= left - 1) {
        const int i = __builtin_ctz(left);
        const uint32_t bit = 1u << i;
        if (!asks(i)) asking &= ~bit;
        if (done(i) + 1 >= maxEvents && !hittable && !hasMedia) bouncing &= ~bit;
        if (settings.behindOnly && done(i) == 0) {
          lambert &= ~bit;
          asking &= ~bit;
          bouncing &= ~bit;
        }
      }
    else if (settings.behindOnly && events == 0) lambert = asking = bouncing = 0;
    for (int h = 0; h < kLanes; h += 8)
      if (lambert >> h & 255u) lanes::moveOrigins(ls, h);
    if (nee && asking != 0) {
      // Lane i asks for light k by the sample that it drew, which was chosen with probability `select`.
      const auto ask = [&](int i, int k, const LightSample& light, float select) {
        const Vec3 p = ls.p.get(i);
        const float cosine = glm::dot(light.direction, ls.n.get(i));
        if (!(cosine > 0.0f) || !(glm::dot(light.direction, ls.facing.get(i)) > 0.0f)) return;
        const float f = kInvPi * cosine, lightPdf = light.pdf * select;
        const float weight = light.delta ? 1.0f : powerHeuristic(lightPdf, f);
        const Vec3 value = paths.throughput.get(i) * ls.albedo.get(i) * light.radiance * lights[k].nominal * (f * weight / lightPdf);
        if (!(maxComponent(value) > 0.0f) && isFinite(value)) return;
        aimShadow(sr, i, p, ls.origin.get(i), light);
        lit.set(i, value);
        if (byLobe) litSpecular.set(i, done(i) == 0 ? Vec3(0.0f) : value * paths.specularPart.get(i));
        litSlot[i] = lights[k].slot;
        if (hasMedia) media.startShadow(i);
        shadowed |= 1u << i;
      };
      if (hasPlainLight) {
        for (uint32_t left = asking; left; left &= left - 1) {
          const int i = __builtin_ctz(left);
          const Vec3 p = ls.p.get(i);
          const PlainMeshLight::Triangle& t = plainLight.pick(drawsChoice ? choice[i] : 0.0f, p, lamp.area[i]);
          if (nearTriangle(p, t.p, t.e1, t.e2)) {
            if (const SphericalTriangle near(p, t.p, t.e1, t.e2); near.valid()) {
              asking &= ~(1u << i);
              LightSample light;
              if (plainLight.sampleNear(t, near, lamp.area[i], Vec2(ux[i], uy[i]), light)) ask(i, plainLightIndex, light, 1.0f);
              continue;
            }
          }
          lamp.p.set(i, t.p);
          lamp.e1.set(i, t.e1);
          lamp.e2.set(i, t.e2);
          lamp.n.set(i, t.n);
        }
        const LightInfo& l = lights[plainLightIndex];
        uint32_t free = 0;
        for (int h = 0; h < kLanes; h += 8)
          if (asking >> h & 255u)
            free |= lanes::sampleLight(ls, paths.throughput, lamp, plainLight.doubleSided, l.nominal, h, asking >> h & 255u, ux, uy, shadowX, shadowY, shadowZ,
                                       shadowReach, litPlain)
                    << h;
        for (uint32_t left = free; left; left &= left - 1) {
          const int i = __builtin_ctz(left);
          putShadow(sr, i, ls.origin.get(i), Vec3(shadowX[i], shadowY[i], shadowZ[i]), shadowReach[i]);
          lit.set(i, litPlain.get(i));
          if (byLobe) litSpecular.set(i, done(i) == 0 ? Vec3(0.0f) : lit.get(i) * paths.specularPart.get(i));
          litSlot[i] = l.slot;
          if (hasMedia) media.startShadow(i);
        }
        shadowed |= free;
      } else {
        for (uint32_t left = asking; left; left &= left - 1) {
          const int i = __builtin_ctz(left);
          const Vec3 p = ls.p.get(i), n = ls.n.get(i);
          float select;
          const int k = selector.sample(p, &n, drawsChoice ? choice[i] : 0.0f, select);
          LightSample light;
          if (k < 0 || !sampler->sample(lights[k].light, p, Vec2(ux[i], uy[i]), light)) continue;
          ask(i, k, light, select);
        }
      }
    }
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
    }

    if (shadowed != 0) {
      for (int i = 0; i < kLanes; ++i) valid[i] = shadowed >> i & 1u ? -1 : 0;
      if (!straight) rays += uint64_t(__builtin_popcount(shadowed));
      if (recorder) record(shadowed, sr, recorder->shadow);
      Vec3 beyond[kLanes];  // what surfaces that bend nothing leave of the light
      if (straight) throughPanes(shadowed, sr, hasMedia ? media.shadow : nullptr, beyond, rays);
      else embree::occluded16(valid, scene, context, sr, false);
      for (uint32_t left = shadowed; left; left &= left - 1) {
        const int i = __builtin_ctz(left);
        if (!(sr.tfar[i] >= 0.0f)) continue;  // Embree writes -inf where something is in the way
        Vec3 value = lit.get(i), gloss = byLobe ? litSpecular.get(i) : Vec3(0.0f);
        if (straight) {
          value *= beyond[i];
          gloss *= beyond[i];
        } else if (hasMedia && media.shadow[i].top() >= 0) {
          const Vec3 left = surfaces.interiors()[size_t(media.shadow[i].top())].transmittance(sr.tfar[i] > 1e30f ? 3.0e38f : glm::length(direction(sr, i)));
          value *= left;
          gloss *= left;
        }
        add(i, litSlot[i], done(i) + 1, done(i) == 0 ? PathClass::Direct : PathClass::Indirect, value, gloss);
      }
    }
    alive = onlyUnlit ? next & paths.specularOnly : next;
  }
  sums.flush(count, out, dropped);
}

}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "trace/path_kernel.h"

#include "trace/area_lights.h"

namespace gobo {

namespace {

// Draws of one scattering event: the light's point, the new direction, (which light, which lobe), roulette.
enum Draw : uint32_t { kDrawLight = 0, kDrawDirection = 1, kDrawChoice = 2, kDrawRoulette = 3, kDrawsPerEvent = 4 };

struct Path {
  Vec3 origin, direction;
  Vec3 throughput;
  Vec3 specularPart;      // share of the first event's specular lobe in the throughput (ByLobe)
  Vec3 from, fromNormal;  // the last vertex, as the light selector saw it
  float pdf;              // density of `direction`; 0 after the camera or a delta event: no other technique finds the light
  int lane;
  bool fromHasNormal, firstDelta;
};

struct Shadow { Vec3 value, specular; int lane, slot; };

// Where contributions go: a sum per sample, so that a sample with a non-finite part can be dropped whole. Pictures with
// several slots keep a list instead of lanes x slots sums.
struct Accumulator {
  struct Record { Vec3 value; int lane, slot; };
  DVec3 sum[kLanes];
  uint32_t bad = 0;       // bit per lane
  bool single;
  std::vector<Record>& records;
  Accumulator(bool single, std::vector<Record>& records) : single(single), records(records) {
    for (DVec3& s : sum) s = DVec3(0.0);
    records.clear();
  }
  void add(int lane, int slot, const Vec3& v) {
    if (!std::isfinite(v.x + v.y + v.z)) { bad |= 1u << lane; return; }
    if (single) sum[lane] += DVec3(v); else records.push_back({v, lane, slot});
  }
  void flush(int count, double* out, uint64_t& dropped) const {
    if (single) {
      DVec3 total(0.0);
      for (int i = 0; i < count; ++i) if (!(bad >> i & 1u)) total += sum[i];
      out[0] += total.x; out[1] += total.y; out[2] += total.z;
    } else {
      for (const Record& r : records) {
        if (bad >> r.lane & 1u) continue;
        double* o = out + 3 * r.slot;
        o[0] += r.value.x; o[1] += r.value.y; o[2] += r.value.z;
      }
    }
    dropped += uint64_t(__builtin_popcount(bad));
  }
};

std::vector<Accumulator::Record>& recordBuffer() {
  static thread_local std::vector<Accumulator::Record> buffer;
  return buffer;
}

float powerHeuristic(float a, float b) {
  if (!(b > 0.0f)) return 1.0f;
  const float r = b / a;                                             // a^2 / (a^2 + b^2) without squares that leave float's range
  return 1.0f / (1.0f + r * r);
}

}  // namespace

void PathTracer::Impl::traceChunk(int x, int y, const SampleSet& set, uint64_t film, int count, double* out, uint64_t& rays,
                                  uint64_t& dropped) const {
  Accumulator sums(slotCount == 1, recordBuffer());
  Path paths[kLanes];
  alignas(64) float ux[kLanes], uy[kLanes], px[kLanes], py[kLanes], vx[kLanes], vy[kLanes], vz[kLanes];
  alignas(64) float choice[kLanes], lobe[kLanes], roulette[kLanes];
  const SplitMode split = settings.split;

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
        if (c == PathClass::Emission) { sums.add(lane, slot, value); return; }
        const int base = slot + (c == PathClass::Direct ? 1 : 3);
        sums.add(lane, base, value - specular);
        sums.add(lane, base + 1, specular);
        return;
    }
  };
  // A ray found light k, which sends `radiance` (for power 1) along it.
  const auto found = [&](const Path& p, int k, int events, const Vec3& radiance, float lightPdf) {
    const LightInfo& l = lights[k];
    const PathClass c = classOf(events, p.firstDelta);
    float weight = 1.0f;
    if (p.pdf > 0.0f) {
      const float select = selector.probability(p.from, p.fromHasNormal ? &p.fromNormal : nullptr, k);
      weight = powerHeuristic(p.pdf, select * lightPdf);
    }
    const Vec3 value = p.throughput * radiance * l.nominal * weight;
    add(p.lane, l.slot, events, c, value, value * p.specularPart);
  };

  // Camera rays.
  if (viewSamples.empty()) set.draw2D(0, px, py);
  for (int i = 0; i < count; ++i) {
    Vec2 offset;
    if (viewSamples.empty()) offset = Vec2(px[i], py[i]);
    else offset = viewSamples[size_t((film + uint64_t(i)) % viewSamples.size())];
    const float fx = float(x) + offset.x, fy = float(y) + offset.y;
    Path& p = paths[i];
    p.origin = cameraOrigin + cameraOriginX * fx + cameraOriginY * fy;
    const Vec3 d = cameraDirection + cameraDirectionX * fx + cameraDirectionY * fy;
    p.direction = d * (1.0f / std::sqrt(glm::dot(d, d)));
    p.throughput = Vec3(1.0f);
    p.specularPart = Vec3(0.0f);
    p.pdf = 0.0f;
    p.lane = i;
    p.fromHasNormal = p.firstDelta = false;
  }

  int alive = count;
  for (int events = 0; alive > 0; ++events) {
    const int n = alive;
    RTCRayHit16 rh;
    alignas(64) int valid[kLanes];
    for (int i = 0; i < kLanes; ++i) {
      valid[i] = i < n ? -1 : 0;
      const Path& p = paths[i < n ? i : 0];
      rh.ray.org_x[i] = p.origin.x; rh.ray.org_y[i] = p.origin.y; rh.ray.org_z[i] = p.origin.z;
      rh.ray.dir_x[i] = p.direction.x; rh.ray.dir_y[i] = p.direction.y; rh.ray.dir_z[i] = p.direction.z;
      rh.ray.tnear[i] = 0.0f; rh.ray.tfar[i] = 3.0e38f; rh.ray.time[i] = 0.0f; rh.ray.mask[i] = ~0u; rh.ray.id[i] = 0; rh.ray.flags[i] = 0;
      rh.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
      rh.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
    }
    embree::Context context;
    embree::initContext(context);
    embree::intersect16(valid, scene, context, rh, events == 0);
    rays += uint64_t(n);
    if (recorder) for (int i = 0; i < n; ++i) (events == 0 ? recorder->primary : recorder->bounce).push_back({paths[i].origin, paths[i].direction, 0.0f, 3.0e38f});

    const bool scatters = events < maxEvents;
    const int event = events + 1;
    const uint32_t base = 1 + uint32_t(events) * kDrawsPerEvent;
    const bool rouletteOn = event >= settings.rouletteStart;
    const bool nee = event == 1 ? wantDirect : wantIndirect;
    if (scatters) {
      if (nee) set.draw2D(base + kDrawLight, ux, uy);
      set.draw2D(base + kDrawDirection, px, py);
      cosineDirections(px, py, vx, vy, vz);
      set.draw2D(base + kDrawChoice, choice, lobe);
      if (rouletteOn) set.draw1D(base + kDrawRoulette, roulette);
    }

    RTCRay16 sr;
    Shadow shadows[kLanes];
    int shadowCount = 0;
    alive = 0;
    for (int i = 0; i < n; ++i) {
      Path& p = paths[i];
      const bool hit = rh.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID;
      const PathClass arrives = classOf(events, p.firstDelta);
      if (!areaLights.empty() && wanted(arrives)) {
        const Ray ray{p.origin, p.direction, 0.0f, hit ? rh.ray.tfar[i] : 3.0e38f};
        for (size_t a = 0; a < areaLights.size(); ++a) {
          const Vec3 oc = Vec3(areaX[a], areaY[a], areaZ[a]) - p.origin;
          const float along = glm::dot(oc, p.direction);
          const Vec3 across = oc - p.direction * along;
          if (glm::dot(across, across) > areaRadius2[a] + 1e-10f * glm::dot(oc, oc)) continue;   // bounding sphere, with room for float
          const int k = areaLights[a];
          if (p.pdf <= 0.0f && !lights[k].cameraVisible) continue;
          float t;
          Vec3 ng;
          if (!intersectAreaLight(areaShapes[a], ray, t, ng)) continue;
          const Vec3 radiance = sampler->emitted(lights[k].light, p.direction, 0, 0, 0, ng);
          found(p, k, events, radiance, p.pdf > 0.0f ? sampler->pdf(lights[k].light, p.from, p.direction, t, 0) : 0.0f);
        }
      }
      if (!hit) {
        if (wanted(arrives)) {
          for (int k : environments) {
            const Vec3 radiance = sampler->emitted(lights[k].light, p.direction, 0, 0, 0, Vec3(0.0f));
            found(p, k, events, radiance, p.pdf > 0.0f ? sampler->pdf(lights[k].light, p.from, p.direction, 3.0e38f, 0) : 0.0f);
          }
        }
        continue;
      }
      const uint32_t instance = rh.hit.instID[0][i] == RTC_INVALID_GEOMETRY_ID ? rh.hit.geomID[i] : rh.hit.instID[0][i];
      const uint32_t primitive = rh.hit.primID[i];
      const float hu = rh.hit.u[i], hv = rh.hit.v[i];
      const Vec3 Ng = accel->impl().worldNormal(instance, Vec3(rh.hit.Ng_x[i], rh.hit.Ng_y[i], rh.hit.Ng_z[i]));
      if (const int k = meshLight[instance]; k >= 0 && wanted(arrives)) {
        const Vec3 radiance = sampler->emitted(lights[k].light, p.direction, primitive, hu, hv, Ng);
        if (maxComponent(radiance) > 0.0f)
          found(p, k, events, radiance, p.pdf > 0.0f ? sampler->pdf(lights[k].light, p.from, p.direction, rh.ray.tfar[i], primitive) : 0.0f);
      }
      if (!scatters) continue;

      Surface s;
      surfaces.interact(instance, primitive, hu, hv, Ng, p.direction, s);
      const Vec3 wo = -p.direction, facing = s.facing();
      const Frame frame(s.n);
      const Vec3 woLocal = frame.toLocal(wo);
      const bool delta = !s.lambert && bsdfIsDelta(s.bsdf);
      const bool hasNormal = !s.material->transmissive;

      if (nee && !delta) {
        float select;
        const int k = selector.sample(s.p, hasNormal ? &s.n : nullptr, choice[p.lane], select);
        LightSample ls;
        if (k >= 0 && sampler->sample(lights[k].light, s.p, Vec2(ux[p.lane], uy[p.lane]), ls)) {
          const float cosine = glm::dot(ls.direction, s.n), side = glm::dot(ls.direction, facing);
          if (cosine * side > 0.0f && (cosine > 0.0f || !hasNormal)) {
            const LightInfo& l = lights[k];
            Vec3 f, specular(0.0f);
            float pdf;
            if (s.lambert) {
              f = s.bsdf.albedo * (kInvPi * cosine);
              pdf = kInvPi * cosine;
            } else {
              const Vec3 wi = frame.toLocal(ls.direction);
              const BsdfValue value = bsdfEval(s.bsdf, woLocal, wi);
              f = value.sum();
              specular = value.specular;
              pdf = ls.delta ? 0.0f : bsdfPdf(s.bsdf, woLocal, wi);
            }
            const float lightPdf = ls.pdf * select;
            const float weight = ls.delta ? 1.0f : powerHeuristic(lightPdf, pdf);
            const Vec3 arriving = p.throughput * ls.radiance * l.nominal * (weight / lightPdf);
            const Vec3 value = arriving * f;
            if (maxComponent(value) > 0.0f || !isFinite(value)) {
              const Vec3 o = s.origin(side > 0.0f ? facing : -facing);
              const int j = shadowCount++;
              Vec3 aim = ls.direction;
              float reach = 3.0e38f;
              if (ls.distance < 3.0e38f) {
                // From the moved origin to the same point of the light; t counts in units of that way. It ends short of the
                // light by what rounding may have put between the sampled point and the light's own surface.
                aim = (s.p - o) + ls.direction * ls.distance;
                const float slack = 3e-6f * std::max(std::fabs(s.p.x), std::max(std::fabs(s.p.y), std::fabs(s.p.z)));
                reach = std::max(0.0f, 1.0f - 2e-5f - slack / ls.distance);
              }
              sr.org_x[j] = o.x; sr.org_y[j] = o.y; sr.org_z[j] = o.z;
              sr.dir_x[j] = aim.x; sr.dir_y[j] = aim.y; sr.dir_z[j] = aim.z;
              sr.tnear[j] = 0.0f;
              sr.tfar[j] = reach;
              shadows[j] = {value, event == 1 ? arriving * specular : value * p.specularPart, p.lane, l.slot};
            }
          }
        }
      }

      if (event == maxEvents && !hittable) continue;                  // the next ray could only find light, and there is none to find
      if (event == 1 && delta && !wantIndirect) continue;
      BsdfSample bs;
      Vec3 wi;
      if (s.lambert) {
        wi = frame.toWorld(Vec3(vx[p.lane], vy[p.lane], vz[p.lane]));
        bs.pdf = vz[p.lane] * kInvPi;
        bs.weight = s.bsdf.albedo;
        if (!(bs.pdf > 0.0f) || !(glm::dot(wi, facing) > 0.0f)) continue;
        p.origin = s.origin(facing);
      } else {
        if (!bsdfSample(s.bsdf, woLocal, lobe[p.lane], Vec2(px[p.lane], py[p.lane]), bs)) continue;
        wi = frame.toWorld(bs.wi);
        wi *= 1.0f / std::sqrt(glm::dot(wi, wi));
        const float side = glm::dot(wi, facing);
        if (bs.transmitted ? !(side < 0.0f) : !(side > 0.0f)) continue;
        p.origin = s.origin(side > 0.0f ? facing : -facing);
        if (event == 1) {
          p.firstDelta = bs.delta;
          if (split == SplitMode::ByLobe) {
            if (bs.delta) {
              p.specularPart = Vec3(1.0f);
            } else {
              const BsdfValue value = bsdfEval(s.bsdf, woLocal, bs.wi);
              const Vec3 all = value.sum();
              for (int c = 0; c < 3; ++c) p.specularPart[c] = all[c] > 0.0f ? value.specular[c] / all[c] : 0.0f;
            }
          }
          if (bs.delta && !wantIndirect) continue;
        }
      }
      p.throughput *= bs.weight;
      const float most = maxComponent(p.throughput);
      if (!isFinite(p.throughput)) { sums.bad |= 1u << p.lane; continue; }
      if (!(most > 0.0f)) continue;
      if (rouletteOn) {
        const float survive = std::fmin(0.95f, most);
        if (roulette[p.lane] >= survive) continue;
        p.throughput *= 1.0f / survive;
      }
      p.direction = wi;
      p.pdf = bs.delta ? 0.0f : bs.pdf;
      p.from = s.p;
      p.fromNormal = s.n;
      p.fromHasNormal = hasNormal;
      if (alive != i) paths[alive] = p;
      ++alive;
    }

    if (shadowCount > 0) {
      for (int i = 0; i < kLanes; ++i) {
        valid[i] = i < shadowCount ? -1 : 0;
        if (i >= shadowCount) { sr.org_x[i] = sr.org_y[i] = sr.org_z[i] = sr.tnear[i] = 0.0f; sr.dir_x[i] = sr.dir_y[i] = sr.dir_z[i] = 1.0f; sr.tfar[i] = -1.0f; }
        sr.time[i] = 0.0f; sr.mask[i] = ~0u; sr.id[i] = 0; sr.flags[i] = 0;
      }
      rays += uint64_t(shadowCount);
      if (recorder)
        for (int i = 0; i < shadowCount; ++i)
          recorder->shadow.push_back({Vec3(sr.org_x[i], sr.org_y[i], sr.org_z[i]), Vec3(sr.dir_x[i], sr.dir_y[i], sr.dir_z[i]), 0.0f, sr.tfar[i]});
      embree::occluded16(valid, scene, context, sr, false);
      for (int i = 0; i < shadowCount; ++i) {
        if (sr.tfar[i] < 0.0f) continue;                              // Embree writes -inf
        const Shadow& h = shadows[i];
        add(h.lane, h.slot, event, event == 1 ? PathClass::Direct : PathClass::Indirect, h.value, h.specular);
      }
    }
  }
  sums.flush(count, out, dropped);
}

}  // namespace gobo

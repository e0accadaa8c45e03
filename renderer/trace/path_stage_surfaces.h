// SPDX-License-Identifier: Apache-2.0
// Stage: surfaces of any material, lane by lane.
#pragma once

#include "trace/path_chunk.h"

namespace gobo {
inline namespace trace {

/// Reads general, rh, the event's numbers; writes next, shadowed with sr, lit, litSpecular, litSlot, litEvent, and the state of lanes that go on.
/// Smooth or textured Lambert joins the vector code by `lambert` and ls, other materials are finished here.
template <PathSink Sink>
inline void PathChunk<Sink>::scatterAtSurfaces() {
  const Accel::Impl& geometry = m.accel->impl();
  for (uint32_t left = general; left; left &= left - 1) {
    const int i = __builtin_ctz(left);
    m.surfaces.prefetchVertices(hitInstance(rh.hit, i), rh.hit.primID[i]);
  }
  for (uint32_t left = general; left; left &= left - 1) {
    const int i = __builtin_ctz(left);
    m.surfaces.prefetchTexels(hitInstance(rh.hit, i), rh.hit.primID[i], rh.hit.u[i], rh.hit.v[i]);
  }
  for (uint32_t left = general; left; left &= left - 1) {
    const int i = __builtin_ctz(left);
    const uint32_t bit = 1u << i;
    const uint32_t instance = hitInstance(rh.hit, i);
    const Vec3 Ng = geometry.worldNormal(instance, Vec3(rh.hit.Ng_x[i], rh.hit.Ng_y[i], rh.hit.Ng_z[i]));
    const Vec3 d = rayDirection(rh.ray, i);
    Surface s;
    m.surfaces.interact(instance, rh.hit.primID[i], rh.hit.u[i], rh.hit.v[i], Ng, d, s);
    const Vec3 facing = s.facing();
    const int volume = s.material->interior;
    if (volume >= 0) {
      if (media.passes(i, volume, s.front)) {
        vertex(i, VertexKind::Surface, done(i) + 1, s.p, s.n);
        passesOn(i, Vec3(1.0f));
        const Vec3 o = s.origin(-facing);
        setRayOrigin(rh.ray, i, o);
        media.cross(i, volume, s.front);
        if (straight) paths.passed[i] += rh.ray.tfar[i];
        else paths.pdf[i] = 0.0f;  // shadow rays stop here: nothing else finds the light beyond
        ++paths.free[i];
        if (paths.free[i] < kMostFree) next |= bit;
        continue;
      }
      if (s.material->dispersion > 0.0f) {  // one channel goes on, for all three; stratified over the samples of a pixel
        if (media.hero[i] < 0) {
          media.hero[i] = int8_t(
              (who.film[i] + channelTurn(who.film[i], m.viewSamples.size()) + set.turnShift(i, who.film[i], 3) + hash64(set.seed(i), 0x64697370u) % 3) % 3);
          Vec3 one(0.0f);
          one[media.hero[i]] = 3.0f * paths.throughput.get(i)[media.hero[i]];
          paths.throughput.set(i, one);
        }
        s.bsdf.ior = dispersedIor(s.bsdf.ior, s.material->dispersion, media.hero[i]);
      }
      s.bsdf.ior = media.relativeIor(i, volume, s.bsdf.ior, s.front);
    }
    const int event = done(i) + 1;
    if (!s.lambert || event > m.maxEvents) vertex(i, VertexKind::Surface, event, s.p, s.n);
    // What the camera sees first is an event, whatever it does: G-buffer and classes begin there.
    const bool mayPass = straight && event > 1 && (s.material->straight || volume >= 0) && bendsAlike(*s.material);
    const auto passOn = [&](const Vec3& weight, const Vec3& carried) {
      passesOn(i, weight);
      const Vec3 o = s.origin(-facing);
      setRayOrigin(rh.ray, i, o);
      if (volume >= 0) {
        media.cross(i, volume, s.front);
        if (const Interior* inside = media.around(i); inside && inside->scatters) media.strayed |= bit;
      }
      paths.throughput.set(i, carried);
      paths.passed[i] += rh.ray.tfar[i];
      if (++paths.free[i] < kMostFree) next |= bit;
    };
    if (event > m.maxEvents) {  // no event is left, but light beyond what bends nothing
      const Vec3 left = mayPass && m.hittable ? bsdfStraight(s.bsdf, s.frame().toLocal(-d)) : Vec3(0.0f);
      if (maxComponent(left) > 0.0f) passOn(left, paths.throughput.get(i) * left);
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
    const BsdfView view(s.bsdf, wo);
    const bool delta = view.isDelta(), hasNormal = !s.material->transmissive;
    if (nee && !delta && asks(i)) {
      float select;
      const int k = m.selector.sample(s.p, hasNormal ? &s.n : nullptr, choice[i], select);
      LightSample light;
      if (k >= 0 && m.sampler->sample(m.lights[k].light, s.p, Vec2(ux[i], uy[i]), light)) {
        const float cosine = glm::dot(light.direction, s.n), side = glm::dot(light.direction, facing);
        if (cosine * side > 0.0f && (cosine > 0.0f || !hasNormal) && (side < 0.0f || !(m.settings.behindOnly && event == 1))) {
          const Vec3 wi = frame.toLocal(light.direction);
          float scatterPdf;
          const BsdfValue f = view.evalPdf(wi, scatterPdf);
          const float lightPdf = light.pdf * select;
          const float weight = light.delta ? 1.0f : powerHeuristic(lightPdf, scatterPdf);
          const Vec3 arriving = throughput * light.radiance * m.lights[k].nominal * (weight / lightPdf);
          const Vec3 value = arriving * f.sum();
          if (maxComponent(value) > 0.0f || !isFinite(value)) {
            aimShadowRay(sr, i, s.p, s.origin(side > 0.0f ? facing : -facing), light);
            lit.set(i, value);
            if (lobes) litSpecular.set(i, event == 1 ? arriving * f.specular : value * paths.specularPart.get(i));
            litSlot[i] = m.lights[k].slot;
            litEvent[i] = event;
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
    if (!goesOn || (event == 1 && delta && !m.wantIndirect)) continue;
    BsdfValue drawn;
    if (!view.sample(lobe[i], Vec2(px[i], py[i]), bs, drawn)) continue;
    if (event == 1) {
      if (bs.delta && !m.wantIndirect) continue;
      if (bs.delta) paths.firstDelta |= bit;
      if (lobes) {
        Vec3 part(1.0f);
        if (!bs.delta) {
          const Vec3 all = drawn.sum();
          for (int c = 0; c < 3; ++c) part[c] = all[c] > 0.0f ? drawn.specular[c] / all[c] : 0.0f;
        }
        paths.specularPart.set(i, part);
      }
    }
    Vec3 wi = frame.toWorld(bs.wi);
    wi *= 1.0f / std::sqrt(glm::dot(wi, wi));
    const float side = glm::dot(wi, facing);
    if (bs.transmitted ? !(side < 0.0f) : !(side > 0.0f) || (m.settings.behindOnly && event == 1)) continue;
    Vec3 carried = throughput * bs.weight;
    const float most = maxComponent(carried);
    if (!isFinite(carried)) {
      bad |= bit;
      continue;
    }
    if (!(most > 0.0f)) continue;
    if (mayPass && bs.straight) {
      passOn(bs.weight, carried);
      continue;
    }
    if (rouletteOn) {
      const float survive = std::min(0.95f, std::sqrt(most));  // see path_tracer.h
      if (roulette[i] >= survive) continue;
      carried *= 1.0f / survive;
    }
    const Vec3 o = s.origin(side > 0.0f ? facing : -facing);
    setRayOrigin(rh.ray, i, o);
    setRayDirection(rh.ray, i, wi);
    scatter(i, wi, bs.weight, event == 1 ? paths.specularPart.get(i) : Vec3(0.0f), bs.delta ? 0.0f : bs.pdf, bs.delta, false);
    if (volume >= 0) {
      const Interior* inside = media.around(i);
      if (bs.transmitted) media.cross(i, volume, s.front);
      // Still the same walk, if an event began it: with the camera in the volume its boundary is the first.
      else if (event > 1 && !s.front && inside && inside->scatters && media.stack[i].top() == volume && paths.free[i] < kMostFree) ++paths.free[i];
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
}

}  // namespace trace
}  // namespace gobo

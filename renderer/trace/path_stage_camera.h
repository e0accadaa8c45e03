// SPDX-License-Identifier: Apache-2.0
// Stages at the head of a pass: camera rays, the lanes' rays through Embree, the numbers of the next event.
#pragma once

#include <algorithm>
#include <cstring>

#include "base/disk.h"
#include "trace/camera_draws.h"
#include "trace/path_chunk.h"

namespace gobo {
inline namespace trace {

/// Draws of one scattering event: the light's point, the new direction, (which light, which lobe), roulette.
enum PathDraw : uint32_t { kDrawLight = 0, kDrawDirection = 1, kDrawChoice = 2, kDrawRoulette = 3, kDrawsPerEvent = 4 };

/// Writes alive, paths, media, the rays in rh; what Embree and vector code read of lanes that are not there.

template <PathSink Sink>
inline void PathChunk<Sink>::startAtCamera() {
  if (hasMedia) media.start(m.surfaces.interiors(), m.cameraMedia);
  alive = who.present;
  // Lanes that are not there have rays too, masked out: their numbers stay ordinary.
  if (m.viewSamples.empty()) set.draw2D(kDrawFilm, px, py);
  if (m.lens && m.viewSamples.empty()) set.draw2D(kDrawLens, ux, uy);
  for (int i = 0; i < kLanes; ++i) {
    Vec2 offset(px[i], py[i]), onLens(0.0f);
    if (!m.viewSamples.empty()) {
      const uint64_t turn = who.film[i] + set.turnShift(i, who.film[i], uint32_t(m.viewSamples.size()));
      offset = m.viewSamples[size_t(turn % m.viewSamples.size())];
      if (m.lens) onLens = m.lensOfViewSample(who.x[i], who.y[i], turn);
    } else if (m.lens) onLens = concentricDisk(Vec2(ux[i], uy[i]));
    const float fx = float(who.x[i]) + offset.x, fy = float(who.y[i]) + offset.y;
    if constexpr (Sink::kVertices)
      if (alive >> i & 1u) sink.film(i, Vec2(fx, fy));
    Vec3 o, d;
    m.startAtFilm(fx, fy, onLens, o, d, paths.reach[i]);
    setRayOrigin(rh.ray, i, o);
    setRayDirection(rh.ray, i, d);
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
  embree::initContext(context);
  if (culls) m.passed.init(cameraContext);
}

/// Reads the rays of `alive`; writes their hits in rh.
template <PathSink Sink>
inline void PathChunk<Sink>::intersect() {
  for (int i = 0; i < kLanes; ++i) {
    valid[i] = alive >> i & 1u ? -1 : 0;
    // What the camera does not see behind its far plane is not there; surfaces that it looks through are on the way.
    rh.ray.tfar[i] = m.clips && paths.fromCamera >> i & 1u ? paths.reach[i] : 3.0e38f;
    rh.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
    rh.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
  }
  if (culls && (alive & paths.fromCamera) != 0) {
    for (int i = 0; i < kLanes; ++i) rh.ray.id[i] = paths.fromCamera >> i & 1u ? BackFaces::kPasses : 0;
    embree::intersect16(valid, m.scene, cameraContext.context, rh, events == 0, BackFaces::filter);
  } else {
    embree::intersect16(valid, m.scene, context, rh, events == 0);
  }
  if (m.clips)
    for (int i = 0; i < kLanes; ++i) paths.reach[i] = std::max(paths.reach[i] - rh.ray.tfar[i], 0.0f);
  rays += uint64_t(__builtin_popcount(alive));
  if (m.recorder) recordRays(alive, rh.ray, events == 0 ? m.recorder->primary : m.recorder->bounce);
}

/// Writes what the coming event is decided by: its numbers, nee, rouletteOn, goesOn. Nobody asks for numbers where no ray met anything: in a picture
/// of a small thing before a sky most packets are like that.
template <PathSink Sink>
inline void PathChunk<Sink>::drawNumbers() {
  // Where the camera is in a volume, paths may have scattered before their first surface.
  nee = (events == 0 ? m.wantDirect || (hasMedia && m.wantIndirect) : m.wantIndirect || (freePasses && m.wantDirect)) && m.selector.count() > 0;
  rouletteOn = events + 1 >= m.settings.rouletteStart;
  goesOn = events + 1 < m.maxEvents || m.hittable || freePasses;
  uint32_t missed = ~0u;
  for (int i = 0; i < kLanes; ++i) missed &= rh.hit.geomID[i];
  if (missed == RTC_INVALID_GEOMETRY_ID && !hasMedia) return;
  if (events < m.maxEvents || freePasses) {
    const uint32_t base = 1 + uint32_t(events) * kDrawsPerEvent;
    static_assert(kDrawLight == 0 && kDrawDirection == 1 && kDrawChoice == 2);
    set.draw3x2D(base, numbers);
    cosineDirections(px, py, vx, vy, vz);
    if (rouletteOn) set.draw1D(base + kDrawRoulette, roulette);
  }
}

}  // namespace trace
}  // namespace gobo

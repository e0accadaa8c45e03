// SPDX-License-Identifier: Apache-2.0
// Stage: random walks inside volumes that scatter.
#pragma once

#include "trace/path_chunk.h"

namespace gobo {
inline namespace trace {

/// Lanes inside something that scatters walk to the end of their last segment, and ask for lights on the way. Reads and writes alive, the
/// rays and hits of such lanes in rh, paths, media. Lane i's walk is one event where it is the path's first, and never direct light.
template <PathSink Sink>
inline void PathChunk<Sink>::walkVolumes() {
  media.walking = 0;
  for (uint32_t left = alive; left; left &= left - 1) {
    const int i = __builtin_ctz(left);
    const uint32_t bit = 1u << i;
    const Interior* inside = media.around(i);
    if (!inside || !inside->scatters) continue;
    media.walking |= bit;
    bool scattered = false;
    const auto collect = [&](const Vec3& o, const Vec3& d, float t) {
      if (!m.areaLights.empty() && done(i) <= m.maxEvents && wanted(classAt(i))) collectAreaLights(i, o, d, t);
    };
    const auto scattersAt = [&](const Vec3& p, const Vec3& d, const Vec3& departing, const Vec3& beta, uint64_t draw) {
      if (events == paths.free[i] || media.strayed & bit) --paths.free[i];
      media.strayed &= ~bit;
      paths.firstDelta |= bit;
      paths.specularOnly &= ~bit;
      paths.fromCamera &= ~bit;
      paths.pdf[i] = 0.0f;
      if constexpr (Sink::kVertices) {
        vertex(i, VertexKind::Volume, done(i), p, Vec3(0.0f));
        scatter(i, departing, Vec3(1.0f), Vec3(0.0f), henyeyGreenstein(glm::dot(d, departing), inside->g), false, false);
      }
      if (!m.wantIndirect || done(i) > m.maxEvents || !m.mediaLights[size_t(media.stack[i].top())]) return;
      int slot;
      const Vec3 value = m.scatteredLight(media, i, p, d, beta, draw, slot, rays);
      if (value != Vec3(0.0f)) contribute(i, slot, done(i), PathClass::Indirect, value, specularOf(i, value));
      paths.pdf[i] = henyeyGreenstein(glm::dot(d, departing), inside->g);
      paths.from.set(i, p);
      paths.fromHasNormal &= ~bit;
      paths.passed[i] = 0.0f;
    };
    const uint64_t key = hash64(hash64(set.seed(i), who.film[i]), 0x77616c6bull << 32 | uint32_t(events));
    if (!media.walk(i, rh, m.scene, paths.throughput, key, rays, scattered, collect, scattersAt) || (scattered && (!m.wantIndirect || done(i) > m.maxEvents)))
      alive &= ~bit;
    media.strayed &= ~bit;
  }
}

}  // namespace trace
}  // namespace gobo

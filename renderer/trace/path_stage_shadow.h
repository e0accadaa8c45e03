// SPDX-License-Identifier: Apache-2.0
// Stage: shadow rays.
#pragma once

#include "trace/path_chunk.h"

namespace gobo {
inline namespace trace {

/// Reads shadowed, sr, lit, litSpecular, litSlot, litEvent; light that nothing hides is contributed.
template <PathSink Sink>
inline void PathChunk<Sink>::traceShadowRays() {
  for (int i = 0; i < kLanes; ++i) valid[i] = shadowed >> i & 1u ? -1 : 0;
  if (!straight) rays += uint64_t(__builtin_popcount(shadowed));
  if (m.recorder) recordRays(shadowed, sr, m.recorder->shadow);
  Vec3 beyond[kLanes];  // what surfaces that bend nothing leave of the light
  if (straight) m.throughPanes(shadowed, sr, hasMedia ? media.shadow : nullptr, beyond, rays);
  else embree::occluded16(valid, m.scene, context, sr);
  for (uint32_t left = shadowed; left; left &= left - 1) {
    const int i = __builtin_ctz(left);
    if (!(sr.tfar[i] >= 0.0f)) continue;  // Embree writes -inf where something is in the way
    Vec3 value = lit.get(i), gloss = lobes ? litSpecular.get(i) : Vec3(0.0f);
    if (straight) {
      value *= beyond[i];
      gloss *= beyond[i];
    } else if (hasMedia && media.shadow[i].top() >= 0) {
      const Vec3 left = m.surfaces.interiors()[size_t(media.shadow[i].top())].transmittance(sr.tfar[i] > 1e30f ? 3.0e38f : glm::length(rayDirection(sr, i)));
      value *= left;
      gloss *= left;
    }
    contribute(i, litSlot[i], litEvent[i], litEvent[i] == 1 ? PathClass::Direct : PathClass::Indirect, value, gloss);
  }
}

}  // namespace trace
}  // namespace gobo

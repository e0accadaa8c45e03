// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "scene/light.h"

namespace gobo {
inline namespace trace {

/// KHR_lights_punctual: squared linear ramp of the cosine between the two cones of a Spot.
inline float spotFalloff(const LightShape& s, float cosine) {
  const float a = clamp01((cosine - s.cosOuter) / maxOf(s.cosInner - s.cosOuter, 1e-3f));
  return a * a;
}

}  // namespace trace
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Texture references at a hit: KHR_texture_transform. Pure functions.
#pragma once

#include "scene/material.h"

namespace gobo {
inline namespace trace {

/// KHR_texture_transform: scale, then rotation (counter-clockwise as seen in the picture, v pointing down), then offset.
inline Vec2 transformUv(const TextureRef& ref, Vec2 uv) {
  uv *= ref.scale;
  if (ref.rotation != 0.0f) {
    const float c = std::cos(ref.rotation), s = std::sin(ref.rotation);
    uv = Vec2(c * uv.x + s * uv.y, c * uv.y - s * uv.x);
  }
  return uv + ref.offset;
}

}  // namespace trace
}  // namespace gobo

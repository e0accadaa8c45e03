// SPDX-License-Identifier: Apache-2.0
// Texture references at a hit: KHR_texture_transform. Pure functions.
#pragma once

#include "scene/material.h"

namespace gobo {
inline namespace trace {

/// What transformUv makes of the difference of two coordinates: all of it but the offset.
inline Vec2 transformUvDifference(const TextureRef& ref, Vec2 d) {
  d *= ref.scale;
  if (ref.rotation != 0.0f) {
    const float c = std::cos(ref.rotation), s = std::sin(ref.rotation);
    d = Vec2(c * d.x + s * d.y, c * d.y - s * d.x);
  }
  return d;
}

/// KHR_texture_transform: scale, then rotation (counter-clockwise as seen in the picture, v pointing down), then offset.
inline Vec2 transformUv(const TextureRef& ref, Vec2 uv) { return transformUvDifference(ref, uv) + ref.offset; }

}  // namespace trace
}  // namespace gobo

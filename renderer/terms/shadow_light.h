// SPDX-License-Identifier: Apache-2.0
// ShadowLightFrame: what axis-aligned filtering knows about an area light: where its plane is and how wide its profile is.
#pragma once

#include "base/hash.h"
#include "scene/light.h"

namespace gobo {

struct ShadowLightFrame {
  Vec3 centre{0.0f};
  Vec3 axis{0, -1, 0};  ///< unit normal of the light plane
  bool facing = false;  ///< sphere: the plane through the centre that faces the receiver; `axis` is not used
  float sigma = 1.0f;   ///< standard deviation of the profile, metres

  /// Normal of the light plane for a receiver at p given relative to the centre.
  Vec3 normalFor(const Vec3& relative) const {
    if (!facing) return axis;
    const float l2 = glm::dot(relative, relative);
    return l2 > 0.0f ? relative / std::sqrt(l2) : axis;
  }
};

/// True for the kinds that have a light plane: Rect, Disk, Sphere.
constexpr bool hasShadowLightFrame(LightKind kind) { return kind == LightKind::Rect || kind == LightKind::Disk || kind == LightKind::Sphere; }

/// Uniform lights by variance matching: a rectangle's side L gives L / sqrt(12), a disk R / 2; the geometric mean of both axes. A
/// sphere counts as the disk that faces the receiver.
inline ShadowLightFrame shadowLightFrame(const LightShape& shape) {
  ShadowLightFrame f;
  f.centre = shape.position;
  f.axis = glm::normalize(shape.axis);
  f.facing = shape.kind == LightKind::Sphere;
  f.sigma = shape.kind == LightKind::Rect ? std::sqrt(glm::length(shape.u) * glm::length(shape.v) / 3.0f) : 0.5f * shape.radius;
  return f;
}

inline void hashShadowLightFrame(Hasher& h, const ShadowLightFrame& f) { h.addPod(f.centre).addPod(f.axis).add(f.facing).add(f.sigma); }

}  // namespace gobo

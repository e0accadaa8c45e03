// SPDX-License-Identifier: Apache-2.0
// ShadowLightFrame: what axis-aligned filtering knows about an area light: where its plane is and how wide its profile is.
//
// A light at infinity (a sun of some size, a rectangle in the sky) is the limit of a light that goes away and grows: its plane is any that faces it, the lines
// to its centre are parallel, and sigma times the slope d1/d2 - 1 of an occluder becomes sigma_theta z. So its slopes are distances z from receiver to occluder
// along the axis, in metres, and its sigma is a tangent, metres a metre: what is made of their product, penumbras and widths, is in metres as ever.
#pragma once

#include <cmath>

#include "base/hash.h"
#include "scene/light.h"

namespace gobo {
inline namespace terms {

struct ShadowLightFrame {
  Vec3 centre{0.0f};
  Vec3 axis{0, -1, 0};   ///< unit normal of the light plane
  bool facing = false;   ///< sphere: the plane through the centre that faces the receiver; `axis` is not used
  float sigma = 1.0f;    ///< standard deviation of the profile, metres; distant: its tangent
  bool distant = false;  ///< at infinity: `centre` is not used, slopes are in metres

  /// Normal of the light plane for a receiver at p given relative to the centre.
  Vec3 normalFor(const Vec3& relative) const {
    if (!facing) return axis;
    const float l2 = glm::dot(relative, relative);
    return l2 > 0.0f ? relative / std::sqrt(l2) : axis;
  }
};

/// True for lights that have a plane and a size: rectangles, disks, spheres, and directional lights of some size.
constexpr bool hasShadowLightFrame(const LightShape& s) {
  return s.kind == LightKind::Rect || s.kind == LightKind::Disk || s.kind == LightKind::Sphere || isWideDirectional(s);
}

/// Uniform lights by variance matching: a rectangle's side L gives L / sqrt(12), a disk R / 2; the geometric mean of both axes. A
/// sphere counts as the disk that faces the receiver. A disk at infinity is uniform by solid angle: the mean square of its tangents along one axis is
/// (1 / cos(half angle) - 1) / 2, near half^2 / 4; a rectangle there is uniform by tangents.
inline ShadowLightFrame shadowLightFrame(const LightShape& shape) {
  ShadowLightFrame f;
  f.centre = shape.position;
  f.axis = glm::normalize(shape.axis);
  if (shape.kind == LightKind::Directional) {
    f.distant = true;
    f.centre = Vec3(0.0f);
    if (shape.angularSize != 0.0f) {
      const double sine = std::sin(0.5 * double(shape.angularSize)), cosine = std::sqrt(1.0 - sine * sine);
      f.sigma = float(std::sqrt(0.5 * sine * sine / ((1.0 + cosine) * cosine)));
    } else {
      f.sigma = std::sqrt(shape.skyRectangle.x * shape.skyRectangle.y / 12.0f);
    }
    return f;
  }
  f.facing = shape.kind == LightKind::Sphere;
  f.sigma = shape.kind == LightKind::Rect ? std::sqrt(glm::length(shape.u) * glm::length(shape.v) / 3.0f) : 0.5f * shape.radius;
  return f;
}

inline void hashShadowLightFrame(Hasher& h, const ShadowLightFrame& f) {
  h.addPod(f.centre).addPod(f.axis).add(f.facing).add(f.sigma);
  if (f.distant) h.add("distant");  // the others keep the keys that they had without
}

}  // namespace terms
}  // namespace gobo

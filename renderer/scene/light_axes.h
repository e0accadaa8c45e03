// SPDX-License-Identifier: Apache-2.0
// Axes of a light's own image (its shadow map, its square in the sky).
#pragma once

#include "scene/light.h"

namespace gobo {

/// z = axis; x along u for rectangles, so that the image is square to them, and for Directional lights whose u is perpendicular to the axis
/// (by which a square light at infinity is turned); any x otherwise.
inline Frame mapFrame(const LightShape& s) {
  const float length = glm::length(s.axis), u = glm::length(s.u);
  const Vec3 z = s.axis / length;
  const float least = s.kind == LightKind::Rect ? 0.5f : s.kind == LightKind::Directional ? 0.999999f : 2.0f;  // sine of the angle
  return u > 0.0f && isFinite(s.u) && glm::length(glm::cross(s.u, z)) > least * u ? Frame(z, s.u / u) : Frame(z);
}

}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Axes of a light's own image (its shadow map, its square in the sky, its emission profile).
#pragma once

#include "scene/light.h"

namespace gobo {
inline namespace scene {

/// z = axis; x along u for rectangles, so that the image is square to them, and for Directional lights whose u is perpendicular to the axis
/// (by which a square light at infinity is turned); any x otherwise.
inline Frame mapFrame(const LightShape& s) {
  const float length = glm::length(s.axis), u = glm::length(s.u);
  const Vec3 z = s.axis / length;
  const float least = s.kind == LightKind::Rect ? 0.5f : s.kind == LightKind::Directional ? 0.999999f : 2.0f;  // sine of the angle
  return u > 0.0f && isFinite(s.u) && glm::length(glm::cross(s.u, z)) > least * u ? Frame(z, s.u / u) : Frame(z);
}

/// Of the emission profile of a Point or Spot light: z = axis, x the picture's right, y its down (a viewer at the lamp, looking along the axis).
/// x is along u as far as the axis allows, turned by profileRotation; any x where u is along the axis.
inline Frame profileFrame(const LightShape& s) {
  const Vec3 z = s.axis / glm::length(s.axis);
  const float u = glm::length(s.u);
  const Frame f = u > 0.0f && isFinite(s.u) && glm::length(glm::cross(s.u, z)) > 1e-3f * u ? Frame(z, s.u / u) : Frame(z);
  if (s.profileRotation == 0.0f) return f;
  return Frame(z, std::cos(s.profileRotation) * f.x - std::sin(s.profileRotation) * f.y);
}

/// A direction that was perpendicular to `from` and goes along with it on the shortest way to `to` (both unit); where they are opposite, about itself.
inline Vec3 carried(const Vec3& direction, const Vec3& from, const Vec3& to) {
  const Vec3 w = glm::cross(from, to);
  const float c = glm::dot(from, to);
  if (!(c > -0.999999f)) return direction;
  const Vec3 turn = glm::cross(w, direction);
  return direction + turn + glm::cross(w, turn) / (1.0f + c);
}

}  // namespace scene
}  // namespace gobo

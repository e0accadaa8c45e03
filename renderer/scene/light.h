// SPDX-License-Identifier: Apache-2.0
// Light: shape (where it is and how it emits) apart from power (how much), because they are different facets: a relight
// that changes power alone re-traces nothing.
#pragma once

#include <cstdint>
#include <string>

#include "base/vec.h"

namespace gobo {
inline namespace scene {

enum class LightKind : uint8_t {
  Point,        ///< delta position; power = radiant intensity, W/sr
  Spot,         ///< point with cone; power = intensity on the axis, W/sr
  Directional,  ///< delta direction, or a sun of some `angularSize`; power = irradiance on a plane facing it, W/m^2, whatever its size
  Rect,         ///< rectangle position +- u +- v, normal `axis`; power = radiance, W m^-2 sr^-1
  Disk,         ///< disk of `radius` around position, normal `axis`; power = radiance
  Sphere,       ///< sphere of `radius` around position, emits outwards; power = radiance
  Mesh,         ///< all triangles of one instance, emission from its material; power = radiance (times emission texture)
  Environment,  ///< radiance from infinity: the scene's environment map; power = scale of the map
};

struct LightShape {
  LightKind kind = LightKind::Point;
  Vec3 position{0.0f};
  Vec3 axis{0, -1, 0};                            ///< unit; direction of emission (Spot, Directional, Rect, Disk)
  Vec3 u{1, 0, 0}, v{0, 0, 1};                    ///< Rect: half edges in metres (perpendicular, cross(u, v) along +-axis)
  float radius = 0.5f;                            ///< Disk, Sphere
  float cosInner = 1.0f, cosOuter = 0.70710678f;  ///< Spot: KHR_lights_punctual falloff
  float range = 0.0f;                             ///< Point, Spot: glTF range in metres, 0 = infinite
  bool twoSided = false;                          ///< Rect, Disk
  uint32_t instance = 0;                          ///< Mesh: index into Scene::instances
  float angularSize = 0.0f;                       ///< Directional: full angle of a uniform disk at infinity, radians, kLeastAngularSize .. pi/2; 0: a direction
  /// Directional, of those that stand for an environment (terms/area_light_list.h): a uniform rectangle at infinity instead of the
  /// disk, 2 tan(half angle) along x and y of mapFrame() (scene/light_axes.h); 0: none.
  Vec2 skyRectangle{0.0f};
  /// Point, Spot: index into Scene::profiles, -1: none. What of the intensity goes where, in profileFrame() (scene/light_axes.h): `u` says where right is.
  int profile = -1;
  float profileRotation = 0.0f;  ///< of the profile about the axis, radians, counter-clockwise as the lamp sees it
};

/// Smaller suns than this (radians) are below what single precision tells apart of directions.
inline constexpr float kLeastAngularSize = 1.7e-6f;

/// A Directional light that is seen under some angle: rays meet it where they leave the scene.
constexpr bool isWideDirectional(const LightShape& s) {
  return s.kind == LightKind::Directional && (s.angularSize != 0.0f || s.skyRectangle.x != 0.0f || s.skyRectangle.y != 0.0f);
}

/// True where an emission profile acts.
constexpr bool hasProfile(const LightShape& s) { return s.profile >= 0 && (s.kind == LightKind::Point || s.kind == LightKind::Spot); }

/// True for lights that a ray cannot hit (so only next-event estimation reaches them).
constexpr bool isDeltaLight(const LightShape& s) {
  return s.kind == LightKind::Point || s.kind == LightKind::Spot || (s.kind == LightKind::Directional && !isWideDirectional(s));
}

struct Light {
  std::string name;  ///< unique in the scene; the handle that requests use
  LightShape shape;
  Vec3 power{1.0f};           ///< linear RGB, unit by kind (above); Mesh: factor x strength of the material's emission
  bool cameraVisible = true;  ///< Rect, Disk, Sphere: false hides it from camera rays, also straight through panes; mirrors and refraction show it.
                              ///< Directional ones are hidden so whatever this says
  /// What `power` is the product of, as its file has them: who edits one keeps the other. An intensity below 0: nothing is known of them.
  Vec3 color{1.0f};
  float intensity = -1.0f;
};

struct LightParts {
  Vec3 color;  ///< linear RGB
  float intensity;
};
/// Colour and intensity whose product is the light's power: its file's, else the intensity is the luminance.
inline LightParts partsOf(const Light& light) {
  if (light.intensity >= 0.0f) return {light.color, light.intensity};
  const float l = luminance(light.power);
  return {l > 0.0f ? light.power / l : Vec3(1.0f), l};
}
inline void setPower(Light& light, const LightParts& parts) {
  light.color = parts.color;
  light.intensity = parts.intensity;
  light.power = parts.color * parts.intensity;
}

/// The scalar used as the nominal power of a light that stands alone in its relight group: such a light is traced as
/// white with this power, and its colour is a gain applied at composition. Never zero, so that a lamp that is off in the
/// scene can be switched on by a gain.
inline float nominalScalar(const Light& light) {
  const float l = luminance(light.power);
  return l > 0.0f && std::isfinite(l) ? l : 1.0f;
}

}  // namespace scene
}  // namespace gobo

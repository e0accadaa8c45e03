// SPDX-License-Identifier: Apache-2.0
// Analytic area lights: rectangle, disk, sphere. Pure functions of (shape, receiver, numbers), in double inside: solid
// angles are differences of angles, and a light may be a micrometre or a kilometre away. 60 to 200 ns a sample.
#pragma once

#include "scene/camera.h"
#include "scene/light.h"

namespace gobo {
inline namespace trace {

/// A direction towards the light with its solid-angle density. `direction` unit, `distance` > 0, metres.
struct AreaSample {
  Vec3 direction{0.0f};
  float distance = 0, pdf = 0;
};

/// Rectangle by solid angle (Urena, Fajardo & King 2013); by area where the solid angle is below 1e-5 sr, there the map's
/// differences of angles lose digits. False: the receiver is behind or in the plane.
bool sampleRect(const LightShape& s, const Vec3& p, const Vec2& u, AreaSample& out);
float rectPdf(const LightShape& s, const Vec3& p, const Vec3& direction, float t);
/// Solid angle of the rectangle as seen from p, sr; 0 in its plane.
double rectSolidAngle(const LightShape& s, const Vec3& p);

/// Disk: by area from 3 radii on; nearer by the solid angle of the square around it, whose corners miss (returns false, so
/// the density integrates to the part that hits): bounded weights where d^2 / cos is not.
bool sampleDisk(const LightShape& s, const Vec3& p, const Vec2& u, AreaSample& out);
float diskPdf(const LightShape& s, const Vec3& p, const Vec3& direction, float t);

/// Sphere: uniform in the cone that it fills; 1 - cos(cone) comes from sin^2, exact for any size. Inside: false (it emits outwards).
bool sampleSphere(const LightShape& s, const Vec3& p, const Vec2& u, AreaSample& out);
float spherePdf(const LightShape& s, const Vec3& p);

/// First emitting point along the ray within (tmin, tmax); back sides of one-sided lights and insides of spheres are
/// transparent, like the lights themselves. Ng: outward normal (Rect, Disk: axis).
bool intersectAreaLight(const LightShape& s, const Ray& ray, float& t, Vec3& Ng);

}  // namespace trace
}  // namespace gobo

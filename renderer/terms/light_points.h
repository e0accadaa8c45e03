// SPDX-License-Identifier: Apache-2.0
// LightPoints: where shadow rays go. Points spread evenly over one light as a receiver sees it: rectangles, disks and mesh lights by
// area, spheres and suns of some angular size by the solid angle of their cone, point-like lights their one direction, rectangles at
// infinity by the tangents around theirs. (Radiance estimators sample by trace/light_sampling.h;
// visibility is a ratio, so it wants points that keep the strata of u and weights that vary slowly.) Immutable; any thread may sample.
#pragma once

#include <vector>

#include "scene/camera.h"
#include "scene/scene.h"
#include "trace/accel.h"

namespace gobo {
inline namespace terms {

struct LightPoint {
  Vec3 direction{0.0f};       ///< unit, from the receiver
  float distance = 0;         ///< metres; 3e38 for Directional
  float weight = 0;           ///< share in the visibility ratio: cosine at the receiver times the light's foreshortening; 1 for point-like lights
  bool belowSurface = false;  ///< above the shading normal's horizon but below the surface itself: nothing arrives from there, shadow or not
};

class LightPoints {
 public:
  /// Reads facets LightShape and, for Mesh lights, Topology, Pose and Coverage of the light's instance. Environment lights are CHECKed against.
  LightPoints(const SceneView& view, int light);

  bool pointLike() const { return isDeltaLight(shape_); }
  /// The point for u in [0,1)^2. False where the light cannot shine on the receiver along it: behind the surface or the light, outside
  /// a spot's cone or a light's range, inside a sphere.
  bool sample(const Vec3& p, const Vec3& N, const Vec3& Ng, Vec2 u, LightPoint& out) const;
  /// True only where sample() is false for every u, at the cost of a product: lights of some size that lie behind the horizon of N, or show p their back.
  /// Not everywhere where it is (by a bounding sphere, with room for rounding).
  bool surelyDark(const Vec3& p, const Vec3& N) const;

 private:
  struct Triangle {
    Vec3 a, ab, ac, normal;
  };
  LightShape shape_;
  Vec3 tangent_{0.0f}, bitangent_{0.0f};  // Disk, rectangle at infinity
  float sun_ = 0.0f;                      // disk at infinity: 1 - cosine of its half angle
  std::vector<Triangle> triangles_;       // Mesh, and the cumulated shares of their areas
  std::vector<double> cumulated_;
  bool meshTwoSided_ = false;
  Vec3 centre_{0.0f};     // of a sphere around a light of some size here
  float radius_ = -1.0f;  // none where negative
};

/// Shadow rays end at this share of the way: mesh lights are in the acceleration structure, and lamps sit on ceilings.
inline constexpr float kShadowRayEnd = 1.0f - 1.0e-4f;
/// Points of a light of some size that are looked at before it counts as one that cannot shine on a receiver: a lamp that arrives in part must not count as
/// seen because the one point drawn could not.
inline constexpr uint32_t kLeastLooked = 16;
/// Ray from a surface towards a light point, ended just before it; the origin leaves the surface on the side of Ng. `reach`: of the surface's instance
/// (Accel::reach), as offsetOrigin() takes it.
Ray shadowRay(const Vec3& reach, const Vec3& p, const Vec3& Ng, const LightPoint& point);

}  // namespace terms
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Sampling points on lights. Every sampler here has a pdf function and a chi-squared test against it.
#pragma once

#include <memory>
#include <vector>

#include "base/stop.h"
#include "scene/scene.h"
#include "trace/light_facet.h"

namespace gobo {
inline namespace trace {

struct LightSample {
  Vec3 direction{0.0f};  ///< unit, from the receiver towards the light
  float distance = 0;    ///< metres; 3e38 for Directional and Environment
  Vec3 radiance{0.0f};   ///< for power 1 (white): incident radiance along -direction; for delta lights intensity/d^2 or irradiance (already the
                         ///< whole contribution before BSDF and cosine)
  float pdf = 0;         ///< solid angle density at the receiver; 1 for delta lights
  bool delta = false;
};

/// Per-light data that sampling needs (triangle alias table of mesh lights, the environment's distribution, ...).
/// Built from a view with facets LightShape, Environment (when the subset has that light), and for Mesh lights Topology,
/// Pose, Shading, Coverage, Emission. Immutable; any thread may sample. Cost a sample: 10 ns (delta lights) to 0.2 us (Rect), 0.3 us (Environment).
class LightSampler {
 public:
  /// Null if `stop` fired first. `draws` false: emitted() and intersectAreaLights() alone will be asked, and no distribution of the environment is made,
  /// which takes milliseconds (a map that turns shows in every picture; what is lit by precomputed transfer draws nothing from it).
  static std::shared_ptr<const LightSampler> build(const SceneView& view, const StopToken& stop = {}, bool draws = true);
  ~LightSampler();

  /// Samples light `i` (index into Scene::lights, must be in the view's subset) as seen from `p`. u in [0,1)^2.
  /// Returns false when the sample cannot contribute (behind, zero radiance, pdf 0).
  bool sample(int i, const Vec3& p, const Vec2& u, LightSample& out) const;
  /// Solid-angle density with which sample(i, p, .) would give `direction`, known to hit the light at distance t
  /// (on `primitive` for mesh lights). 0 for delta lights.
  float pdf(int i, const Vec3& p, const Vec3& direction, float t, uint32_t primitive) const;
  /// The same for who has asked emitted() of that direction: a map's density is known by its radiance.
  float pdf(int i, const Vec3& p, const Vec3& direction, float t, uint32_t primitive, const Vec3& emitted) const;
  /// Emitted radiance for power 1 (white x texture) of a non-delta light towards -direction from a ray hit
  /// (mesh: uses primitive and barycentrics u, v, and the light's own normal; environment and directional: direction alone).
  Vec3 emitted(int i, const Vec3& direction, uint32_t primitive, float u, float v, const Vec3& Ng) const;
  /// Nearest hit with the emitting sides of Rect, Disk, Sphere lights of the subset within (ray.tmin, ray.tmax); -1 if none.
  /// These lights block nothing (shadow rays do not see them): a ray that is to meet every light on its way asks again with
  /// tmin = the t it got. cameraVisibleOnly: lights hidden from the camera are passed.
  int intersectAreaLights(const Ray& ray, float& t, Vec3& Ng, bool cameraVisibleOnly = false) const;

  /// Of a mesh light that shines evenly and has no more than `most` triangles: them, and whether they shine to both sides. Empty of others.
  std::vector<LightFacet> facets(int i, size_t most, bool& twoSided) const;

  struct Impl;
  const Impl& impl() const { return *impl_; }

 private:
  LightSampler();
  std::unique_ptr<Impl> impl_;
};

}  // namespace trace
}  // namespace gobo

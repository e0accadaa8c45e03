// SPDX-License-Identifier: Apache-2.0
// Photons of point, spot and directional lights, sent only where a specular chain can begin: towards the bounding spheres of
// the instances that may reflect or refract by a delta lobe (cones from a point, discs across a direction). Every chain's first
// surface is such an instance, so nothing is left out, and the density is known: sum over the spheres that hold the ray.
// A spot whose cone is smaller than its targets is sampled by its cone, a light whose profile is narrower than either by its profile.
// Immutable; any thread. Cost: O(targets), at most 64.
#pragma once

#include <optional>
#include <vector>

#include "scene/scene.h"
#include "trace/emission_profile.h"
#include "trace/surface.h"

namespace gobo {
inline namespace trace {

struct Sphere {
  Vec3 centre{0.0f};
  float radius = 0;
};

/// True if the material may scatter by a delta lobe, or passes light straight on at a boundary, for some value of its textures.
bool mayBeSpecular(const SurfaceMaterial& material);
/// Bounding spheres of the instances whose material may be specular; one sphere around all if there are more than 64.
std::vector<Sphere> specularTargets(const SceneView& view, const SurfaceTable& surfaces);
/// Sphere around all instances; radius 0 if there are none.
Sphere sceneSphere(const SceneView& view);

struct PhotonStart {
  Vec3 origin, direction;
  float power = 0;  ///< W of a single photon for a light of power 1: emitted power over density; divide by their number
  Vec3 tint{1.0f};  ///< what the light's profile makes of it
};

class PhotonEmitter {
 public:
  /// `scene`: sphere around the scene, from outside which directional light starts. `profile`: of a Point or Spot light; null: none.
  PhotonEmitter(const LightShape& light, std::vector<Sphere> targets, const Sphere& scene, LightProfilePtr profile = nullptr);
  /// False: this number gives no photon (dark direction). uTarget and u in [0,1).
  bool emit(float uTarget, const Vec2& u, PhotonStart& out) const;
  /// KHR_lights_punctual range window after a way of `length` metres along the chain.
  float window(float length) const;

 private:
  struct Target {
    Vec3 axis{0.0f}, centre{0.0f};
    float radius = 0, sine2 = 2;   // of the cone's half angle; 2: every direction
    double gap = 2;                // 1 - cosine of it, without cancellation
    double weight = 0, until = 0;  // sr or m^2; running sum
  };
  double density(const Vec3& direction, const Vec3& point) const;
  bool tinted(PhotonStart& out) const;
  LightShape light_;
  std::optional<EmissionProfile> profile_;
  std::optional<ProfileDistribution> distribution_;
  std::vector<Target> targets_;
  double total_ = 0;
  bool byCone_ = false, byProfile_ = false;
  float away_ = 0;
};

}  // namespace trace
}  // namespace gobo

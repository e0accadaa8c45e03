// SPDX-License-Identifier: Apache-2.0
// Scene: an immutable value made of facets, with a Merkle hash. Edits make a new Scene that shares what did not change.
// Any thread may read a Scene; nobody may change one after seal().
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "base/array.h"
#include "base/hash.h"
#include "base/status.h"
#include "base/vec.h"
#include "scene/camera.h"
#include "scene/environment.h"
#include "scene/light.h"
#include "scene/light_profile.h"
#include "scene/material.h"
#include "scene/mesh_view.h"
#include "scene/rig.h"

namespace gobo {
inline namespace base {
class MappedFile;  // base/mapped_file.h
}
}  // namespace gobo

namespace gobo {
inline namespace scene {

struct Instance {
  std::string name;  ///< unique; glTF node name (+ "#k" for further primitives or duplicates)
  int mesh = 0;
  Mat4 toWorld{1.0f};  ///< affine
};

struct Scene {
  std::string name;
  std::vector<MeshPtr> meshes;
  std::vector<Instance> instances;
  std::vector<Material> materials;
  std::vector<std::shared_ptr<const Texture>> textures;
  std::vector<Light> lights;              ///< includes one Mesh light per emissive instance, and one Environment light if any
  std::vector<LightProfilePtr> profiles;  ///< what lights refer to; sealed (sealProfile)
  EnvironmentPtr environment;             ///< null: black
  std::vector<Camera> cameras;            ///< at least one after seal()
  RigPtr rig;                             ///< null: nothing in it can be animated; sealed (sealRig)
  Variants variants;                      ///< KHR_materials_variants
  /// Where these coordinates begin in the file's, m; not 0 where the file puts everything so far away that floats would be too coarse there
  /// (import/gltf/origin.h). No digest has it: pictures do not depend on it.
  DVec3 origin{0.0};
  std::vector<std::string> warnings;       ///< what the loader repaired or ignored
  std::shared_ptr<const MappedFile> file;  ///< that arrays of it, and of scenes made from it, look into; null: none

  /// Digest of the facets in `set`; light facets cover only `lightSubset` (indices into lights). Mesh lights pull in the
  /// topology, pose and emission of their instance. O(number of materials + lights): facet digests are cached by seal().
  Hash128 facetHash(Facet set, const std::vector<int>& lightSubset) const;
  /// Whether the environment is part of that: light is seen from the lights of a subset alone, so a map that turns concerns nobody whose lights it is not
  /// among.
  bool seesEnvironment(Facet set, const std::vector<int>& lightSubset) const;
  /// Merkle root over every facet and every light; the scene's identity.
  Hash128 hash() const { return root_; }
  /// Makes Mesh lights for emissive instances (unless present; named after the instance, power = the material's emission;
  /// from then on the light's power is the truth), the light "environment" if there is a map and no such light, a default
  /// camera that frames the bounds if none; names nameless instances and lights; computes digests. O(vertices) for meshes
  /// not seen by an earlier seal, else O(objects). Errors (InvalidArgument, location = scene name + JSON-pointer-like place):
  /// an index out of range, array sizes that disagree, non-finite positions, transforms, lights or cameras, duplicate names.
  Status seal();

  int findLight(std::string_view name) const;  ///< -1 if absent
  int findCamera(std::string_view name) const;
  int findInstance(std::string_view name) const;
  int findMaterial(std::string_view name) const;
  size_t triangleCount() const;           ///< over instances
  size_t bytes() const;                   ///< host memory of meshes, textures and environment
  void bounds(Vec3& lo, Vec3& hi) const;  ///< world box around all instances' (turned) mesh boxes; lo > hi when empty; after seal()

 private:
  struct MeshCheck {
    MeshPtr mesh;
    Vec3 lo, hi;
  };
  Status checkMeshes();
  Status checkMaterials() const;
  Status checkLights() const;
  Status checkNames() const;
  Status checkVariants() const;
  void addLights();
  void addCamera();
  void computeDigests();
  Hash128 refHash(const TextureRef& ref) const;
  std::vector<MeshCheck> checked_;  // meshes that an earlier seal() of this scene or its base has walked, with their bounds
  Hash128 facet_[11];
  std::vector<Hash128> lightShape_, lightPower_;
  Hash128 root_;
};

/// What a node may see of a scene: reading a facet that it did not declare fails a CHECK, so a wrong declaration (and
/// with it a wrong key) is found by the first test that runs the node.
class SceneView {
 public:
  SceneView(const Scene& scene, Facet allowed, const std::vector<int>& lights) : scene_(&scene), allowed_(allowed), lights_(&lights) {}
  Facet allowed() const { return allowed_; }
  const std::vector<int>& lightSubset() const { return *lights_; }
  /// A mesh's arrays of facets F. An array of another facet is not there: reading it does not compile.
  template <Facet F>
  MeshView<F> mesh(int m) const {
    require(F);
    const Mesh& mesh = *scene_->meshes[size_t(m)];
    return MeshView<F>(mesh, scene_->materials[size_t(mesh.material)].coverage.mode != AlphaMode::Opaque);
  }
  size_t meshCount() const { return scene_->meshes.size(); }
  /// For who keeps pointers into the arrays of a MeshView longer than the scene may live.
  std::vector<std::shared_ptr<const void>> keepMeshes() const { return {scene_->meshes.begin(), scene_->meshes.end()}; }
  const std::vector<Instance>& instances() const {
    require(Facet::Topology | Facet::Pose);
    return scene_->instances;
  }
  const std::vector<std::shared_ptr<const Texture>>& textures() const { return scene_->textures; }  // reached through a TextureRef of a checked facet
  size_t materialCount() const { return scene_->materials.size(); }
  const Coverage& coverage(int m) const {
    require(Facet::Coverage);
    return scene_->materials[m].coverage;
  }
  const Albedo& albedo(int m) const {
    require(Facet::Albedo);
    return scene_->materials[m].albedo;
  }
  const Bsdf& bsdf(int m) const {
    require(Facet::Bsdf);
    return scene_->materials[m].bsdf;
  }
  const Emission& emission(int m) const {
    require(Facet::Emission);
    return scene_->materials[m].emission;
  }
  const LightShape& lightShape(int i) const {
    require(Facet::LightShape);
    requireLight(i);
    return scene_->lights[i].shape;
  }
  /// The emission profile of a Point or Spot light; null: none.
  LightProfilePtr lightProfile(int i) const {
    const LightShape& s = lightShape(i);
    return hasProfile(s) ? scene_->profiles[size_t(s.profile)] : nullptr;
  }
  bool lightCameraVisible(int i) const {
    require(Facet::LightShape);
    requireLight(i);
    return scene_->lights[i].cameraVisible;
  }
  const Vec3& lightPower(int i) const {
    require(Facet::LightPower);
    requireLight(i);
    return scene_->lights[i].power;
  }
  /// Not there for who declares light shapes and has no environment light among them (Scene::seesEnvironment).
  const EnvironmentPtr& environment() const {
    require(Facet::Environment);
    requireSeen();
    return scene_->environment;
  }
  /// Digest of facets other than the lights', for what caches by it (AccelCache).
  Hash128 digest(Facet facets) const {
    require(facets);
    return scene_->facetHash(facets, {});
  }
  /// The mapping under the arrays: what keeps pointers into them is of no use to the same scene in another one (0: in none).
  uint64_t mapping() const;

 private:
  void require(Facet f) const;     ///< CHECK
  void requireLight(int i) const;  ///< CHECK
  void requireSeen() const;        ///< CHECK: the environment is seen
  const Scene* scene_;
  Facet allowed_;
  const std::vector<int>* lights_;
};

}  // namespace scene
}  // namespace gobo

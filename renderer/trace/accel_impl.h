// SPDX-License-Identifier: Apache-2.0
// What an Accel is made of; for the tracer, which talks to Embree in packets. Immutable after build.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "trace/accel.h"
#include "trace/embree.h"

namespace gobo {
inline namespace trace {

/// What an intersection filter needs to look up coverage. One per alpha geometry; keeps its texture alive, the Accel its mesh.
struct AlphaGeometry {
  const uint32_t* indices = nullptr;       ///< 3 per triangle
  const Array<Vec2>* uv = nullptr;         ///< of the alpha texture; may be empty
  const Array<Vec4>* colours = nullptr;    ///< may be empty
  std::shared_ptr<const Texture> texture;  ///< null: no texture
  TextureRef ref;
  AlphaMode mode = AlphaMode::Opaque;
  float cutoff = 0.5f, factor = 1.0f;
  /// Coverage at barycentrics (u, v) of `primitive`: factor x vertex alpha x texture alpha.
  float alpha(uint32_t primitive, float u, float v) const;
};

/// Object-to-world data of one instance, ready for interpolation at a hit.
struct InstanceGeometry {
  const uint32_t* indices = nullptr;  ///< 3 per triangle
  const Vec3* positions = nullptr;    ///< world space when `world`, else object space
  bool world = true;                  ///< flattened
  bool mirrored = false;              ///< determinant of toWorld < 0
  Mat4 toWorld{1.0f};
  Mat3 normalToWorld{1.0f};  ///< cofactors of toWorld's linear part times the sign of its determinant: takes object-space
                             ///< normals, cross(e1, e2) among them, to the outside; finite for flattening scales too
};

struct Accel::Impl {
  RTCScene scene = nullptr;
  std::vector<RTCScene> meshScenes;                 ///< by mesh; null unless instanced
  std::vector<InstanceGeometry> instances;          ///< by Scene::instances index == Embree geometry id
  std::vector<std::vector<Vec3>> worldPositions;    ///< by instance; empty when instanced by Embree
  std::vector<std::vector<Vec3>> objectPositions;   // by mesh; padded copies of the instanced ones
  std::vector<std::shared_ptr<const void>> meshes;  ///< kept alive: Embree and alpha tests read their buffers
  std::vector<std::unique_ptr<AlphaGeometry>> alphas;
  bool hasAlpha = false;
  float unit = 1.0f;
  Vec3 reach{1.0f};
  std::vector<Vec3> instanceReach;  ///< by instance
  size_t bytes = 0;
  ~Impl();

  /// Unit normal of a hit from Embree's (unnormalised) normal. Zero-area normals give +Y.
  Vec3 worldNormal(uint32_t instance, const Vec3& embreeNormal) const {
    const InstanceGeometry& g = instances[instance];
    Vec3 n = embreeNormal;
    if (!g.world) n = g.normalToWorld * n;
    else if (g.mirrored) n = -n;
    const float m = std::fmax(std::fabs(n.x), std::fmax(std::fabs(n.y), std::fabs(n.z)));
    if (m > 1e-15f && m < 1e15f) return n * (1.0f / std::sqrt(glm::dot(n, n)));
    if (!(m > 0.0f) || !std::isfinite(m)) return Vec3(0, 1, 0);
    n *= 1.0f / m;  // squares of tiny or huge components would leave float's range
    return n * (1.0f / std::sqrt(glm::dot(n, n)));
  }
};

}  // namespace trace
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// What a path sees at a hit: position with its rounding bound, normals, and BSDF parameters. SurfaceTable flattens the scene
// into arrays indexed by instance and material, so that a hit costs no indirection through the scene model.
// Immutable after build; pure look-ups; any thread.
#pragma once

#include <bit>
#include <vector>

#include "trace/accel_impl.h"
#include "trace/bsdf.h"
#include "trace/interior.h"

namespace gobo {
inline namespace trace {

/// A texture with how it is looked up; null texture: none.
struct SurfaceTexture {
  const Texture* texture = nullptr;
  TextureRef ref;
  explicit operator bool() const { return texture != nullptr; }
};

struct SurfaceMaterial {
  BsdfParams constant;        ///< with every factor filled in
  bool lambert = false;       ///< constant parameters are an exact Lambert surface (albedo may be textured)
  bool textured = false;      ///< a texture, vertex colours or a tangent are needed
  bool transmissive = false;  ///< light may come from behind
  bool unlit = false;
  bool extended = false;      ///< more than metallic, roughness, specular, ior and solid transmission
  bool straight = false;      ///< light may go straight on through it (trace/straight.h)
  bool lobeTextured = false;  ///< any texture but those of albedo, metallic-roughness and normal; or anisotropy
  int interior = -1;          ///< index into SurfaceTable::interiors(), -1: bounds no volume
  float dispersion = 0;
  float normalScale = 1.0f, coatNormalScale = 1.0f, anisotropyRotation = 0, iridescenceThicknessMin = 0;
  SurfaceTexture albedo, metallicRoughness, normal;
  SurfaceTexture specular, specularColor, transmission, diffuseTransmission, diffuseTransmissionColor, clearcoat, clearcoatRoughness, clearcoatNormal,
      sheenColor, sheenRoughness, anisotropy, iridescence, iridescenceThickness;
};

/// Flattens one material; `textures` must outlive it. `interior` is left to the table.
SurfaceMaterial makeSurfaceMaterial(const Albedo& albedo, const Bsdf& bsdf, const std::vector<std::shared_ptr<const Texture>>& textures);

struct SurfaceInstance {
  const uint32_t* indices = nullptr;
  const Vec3* positions = nullptr;  ///< world space when `world`
  const Vec3* normals = nullptr;    ///< object space; null: flat
  const Vec4* tangents = nullptr;
  const Vec2* uv[kUvSets] = {};
  const Vec4* colours = nullptr;
  const SurfaceMaterial* material = nullptr;
  bool world = true, identity = true, mirrored = false;
  bool unlit = false;
  bool plainLambert = false;  ///< world space, untextured Lambert: the vector code does it all
  Mat4 toWorld{1.0f};
  Mat3 normalToWorld{1.0f};
};

struct Surface {
  Vec3 p;             ///< world position from the triangle's vertices (closer than origin + t direction)
  Vec3 reach;         ///< sum of the absolute values that went into p: rounding errors scale with it
  Vec3 Ng;            ///< outside normal
  Vec3 n;             ///< shading normal on the viewer's side, never facing away from the viewer
  bool front = true;  ///< the viewer is outside
  bool lambert = false;
  const SurfaceMaterial* material = nullptr;
  BsdfParams bsdf;
  Vec3 tangent{0.0f};       ///< direction of the frame's x where `hasTangent`
  bool hasTangent = false;  ///< only materials that care (anisotropy) have one

  /// The frame that `bsdf` is given in.
  Frame frame() const { return hasTangent ? Frame(n, tangent) : Frame(n); }
  /// Geometric normal on the viewer's side.
  Vec3 facing() const { return front ? Ng : -Ng; }
  /// Where a ray to the side of `side` (unit, +-Ng) begins.
  Vec3 origin(const Vec3& side) const { return offsetOrigin(p, side, reach); }
};

class SurfaceTable {
 public:
  void build(const SceneView& view, const Accel& accel);
  /// Fills `out` for a hit of a ray of unit direction `d`; Ng is the unit outside normal (Hit::Ng).
  /// Textures are read only where the material has them.
  void interact(uint32_t instance, uint32_t primitive, float u, float v, const Vec3& Ng, const Vec3& d, Surface& out) const {
    const SurfaceInstance& s = instances_[instance];
    const uint32_t* tri = s.indices + 3 * size_t(primitive);
    const uint32_t a = tri[0], b = tri[1], c = tri[2];
    const float w = 1.0f - u - v;
    const Vec3 pa = w * s.positions[a], pb = u * s.positions[b], pc = v * s.positions[c];
    out.p = pa + pb + pc;
    out.reach = glm::abs(pa) + glm::abs(pb) + glm::abs(pc);
    if (!s.world) toWorld(s, out);
    out.material = s.material;
    out.Ng = Ng;
    out.front = glm::dot(Ng, d) < 0.0f;
    const Vec3 facing = out.front ? Ng : -Ng;
    out.n = facing;
    if (s.normals) out.n = usable(vertexNormal(s, tri, u, v), facing, d);
    out.hasTangent = false;
    out.lambert = s.material->lambert;
    out.bsdf = s.material->constant;
    out.bsdf.entering = out.front;
    if (s.material->textured || s.colours) detail(s, a, b, c, w, u, v, d, out);
    if (!out.lambert && out.n != facing) out.bsdf.facing = out.frame().toLocal(facing);  // nothing else may decide what a tilted normal loses
  }
  // A hit's triangle, its vertices and its texels lie anywhere in memory, one behind the other. Who has several hits asks for each of these of
  // all before it reads the first; nothing but time depends on it.
  void prefetchTriangle(uint32_t instance, uint32_t primitive) const { __builtin_prefetch(instances_[instance].indices + 3 * size_t(primitive)); }
  void prefetchVertices(uint32_t instance, uint32_t primitive) const {
    const SurfaceInstance& s = instances_[instance];
    const uint32_t* tri = s.indices + 3 * size_t(primitive);
    for (int k = 0; k < 3; ++k) {
      __builtin_prefetch(s.positions + tri[k]);
      if (s.normals) __builtin_prefetch(s.normals + tri[k]);
      if (!s.material->textured) continue;
      if (s.uv[0]) __builtin_prefetch(s.uv[0] + tri[k]);
      if (s.tangents) __builtin_prefetch(s.tangents + tri[k]);
    }
  }
  void prefetchTexels(uint32_t instance, uint32_t primitive, float u, float v) const {
    const SurfaceInstance& s = instances_[instance];
    if (s.material->textured) texels(s, primitive, u, v);
  }
  const SurfaceInstance& instance(uint32_t i) const { return instances_[i]; }
  const std::vector<Interior>& interiors() const { return interiors_; }
  int interiorOf(int material) const { return materials_[size_t(material)].interior; }
  /// Some instance lets light through straight on: shadow rays have to ask what is left of them (trace/straight.h).
  bool anyStraight() const { return anyStraight_; }
  /// The normal that the vertices give a point of a triangle, world axes, any length and side; `s` has normals.
  static Vec3 vertexNormal(const SurfaceInstance& s, const uint32_t* tri, float u, float v) {
    const Vec3 n = (1.0f - u - v) * s.normals[tri[0]] + u * s.normals[tri[1]] + v * s.normals[tri[2]];
    return s.identity ? n : s.normalToWorld * n;
  }
  bool anyUnlit() const { return anyUnlit_; }

 private:
  struct Place {
    uint32_t a, b, c;
    float w, u, v;
  };  // vertices and their weights
  struct TangentSpace {
    Vec3 normal, tangent, bitangent;
  };  // world space, orthonormal; the normal as the vertices have it
  static void toWorld(const SurfaceInstance& s, Surface& out);
  static bool tangentSpace(const SurfaceInstance& s, const Place& at, const TextureRef& ref, const Surface& out, TangentSpace& space);
  static Vec2 uvAt(const SurfaceInstance& s, const Place& at, const TextureRef& ref);
  static Vec3 mapped(const SurfaceInstance& s, const Place& at, const SurfaceTexture& map, float scale, const Vec3& d, const Surface& out);
  static void texels(const SurfaceInstance& s, uint32_t primitive, float u, float v);
  static void lobes(const SurfaceInstance& s, const Place& at, Surface& out);
  static void anisotropy(const SurfaceInstance& s, const Place& at, Surface& out);
  static void detail(const SurfaceInstance& s, uint32_t a, uint32_t b, uint32_t c, float w, float u, float v, const Vec3& d, Surface& out);
  // Normalised, on the side of `facing` (lanes::shadingNormal does the same); `facing` itself where the interpolated normal is unusable or turns away from the
  // viewer.
  static Vec3 usable(const Vec3& n, const Vec3& facing, const Vec3& d) {
    const float l = glm::dot(n, n);
    if (!(l > 1e-24f && l < 1e24f)) return facing;
    Vec3 m = n * (1.0f / std::sqrt(l));
    if (glm::dot(m, facing) < 0.0f) m = -m;
    return glm::dot(m, d) < -1e-4f ? m : facing;
  }
  bool anyUnlit_ = false, anyStraight_ = false;
  std::vector<Interior> interiors_;
  std::vector<SurfaceInstance> instances_;
  std::vector<SurfaceMaterial> materials_;
  std::vector<std::shared_ptr<const void>> keep_;
  std::vector<std::shared_ptr<const Texture>> textures_;
};

}  // namespace trace
}  // namespace gobo

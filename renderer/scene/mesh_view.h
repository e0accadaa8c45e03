// SPDX-License-Identifier: Apache-2.0
// Facets, meshes, and what a node may see of a mesh: a MeshView<F> holds the arrays of the facets F and no others, so that a
// node which reads an array of a facet that it did not declare does not compile.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <type_traits>

#include "base/array.h"
#include "base/hash.h"
#include "base/vec.h"
#include "scene/material.h"

namespace gobo {
inline namespace scene {

/// Facets: the parts of a scene that a source may depend on. A node declares the set that it reads.
enum class Facet : uint32_t {
  None = 0,
  Topology = 1 << 0,     ///< triangle indices, which mesh has which material, which instance has which mesh
  Pose = 1 << 1,         ///< vertex positions, instance transforms
  Shading = 1 << 2,      ///< normals, tangents, texture coordinates, vertex colours
  Coverage = 1 << 3,     ///< alpha mode, cutoff, alpha texture, double-sidedness; shading arrays of meshes whose material is not opaque
  Albedo = 1 << 4,       ///< base colour factor and texture
  Bsdf = 1 << 5,         ///< everything in struct Bsdf: lobes, their textures, interior, normal map
  Emission = 1 << 6,     ///< emissive texture and the direction of emission (which surfaces emit), not its strength
  LightShape = 1 << 7,   ///< LightShape of the lights in the node's subset
  LightPower = 1 << 8,   ///< nominal power of the lights in the node's subset
  Environment = 1 << 9,  ///< map and rotation, not its scale
  Cameras = 1 << 10,
  All = (1 << 11) - 1,
};
constexpr Facet operator|(Facet a, Facet b) { return Facet(uint32_t(a) | uint32_t(b)); }
constexpr Facet operator&(Facet a, Facet b) { return Facet(uint32_t(a) & uint32_t(b)); }
constexpr bool has(Facet set, Facet f) { return (uint32_t(set) & uint32_t(f)) == uint32_t(f); }
const char* facetName(Facet single);

/// One material's triangles in object space. Immutable and shared between scenes.
struct Mesh {
  std::string name;
  Array<uint32_t> indices;  ///< 3 per triangle
  Array<Vec3> positions;
  Array<Vec3> normals;                  ///< empty: flat shading
  Array<Vec4> tangents;                 ///< empty: derived from uv when a normal map needs them
  std::array<Array<Vec2>, kUvSets> uv;  ///< TEXCOORD_0..; empty: (0,0)
  Array<Vec4> colours;                  ///< COLOR_0, linear RGBA; empty: white
  int material = 0;
  Hash128 topologyHash, positionsHash, shadingHash;  ///< set by sealMesh
  size_t triangles() const { return indices.size() / 3; }
};
/// Fills the digests; call once, when the arrays are final.
void sealMesh(Mesh& mesh);

namespace mesh_parts {
struct Topology {
  const Array<uint32_t>& indices;
  int material;
  explicit Topology(const Mesh& m, bool) : indices(m.indices), material(m.material) {}
  size_t triangles() const { return indices.size() / 3; }
};
struct Pose {
  const Array<Vec3>& positions;
  explicit Pose(const Mesh& m, bool) : positions(m.positions) {}
};
struct Shading {
  const Array<Vec3>& normals;
  const Array<Vec4>& tangents;
  const std::array<Array<Vec2>, kUvSets>& uv;
  const Array<Vec4>& colours;
  explicit Shading(const Mesh& m, bool) : normals(m.normals), tangents(m.tangents), uv(m.uv), colours(m.colours) {}
};
/// What an alpha test reads, which is part of facet Coverage for such meshes; null for opaque ones.
struct Coverage {
  const std::array<Array<Vec2>, kUvSets>* alphaUv;
  const Array<Vec4>* alphaColours;
  explicit Coverage(const Mesh& m, bool alphaTested) : alphaUv(alphaTested ? &m.uv : nullptr), alphaColours(alphaTested ? &m.colours : nullptr) {}
};
template <int>
struct None {
  explicit None(const Mesh&, bool) {}
};
template <Facet F, Facet Of, typename Part>
using If = std::conditional_t<has(F, Of), Part, None<int(Of)>>;
}  // namespace mesh_parts

/// By SceneView::mesh(). A few pointers; valid as long as the mesh.
template <Facet F>
struct MeshView : mesh_parts::If<F, Facet::Topology, mesh_parts::Topology>,
                  mesh_parts::If<F, Facet::Pose, mesh_parts::Pose>,
                  mesh_parts::If<F, Facet::Shading, mesh_parts::Shading>,
                  mesh_parts::If<F, Facet::Coverage, mesh_parts::Coverage> {
  MeshView(const Mesh& m, bool alphaTested)
      : mesh_parts::If<F, Facet::Topology, mesh_parts::Topology>(m, alphaTested),
        mesh_parts::If<F, Facet::Pose, mesh_parts::Pose>(m, alphaTested),
        mesh_parts::If<F, Facet::Shading, mesh_parts::Shading>(m, alphaTested),
        mesh_parts::If<F, Facet::Coverage, mesh_parts::Coverage>(m, alphaTested) {}
};

}  // namespace scene
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Dense meshes thinned to points: corners of small triangles that lie in one cube of space and face one way are one point, and each corner is interpolated
// between its own point and those that triangles connect it with. Pure.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "base/vec.h"

namespace gobo::transfer {

/// Corners of a mesh by their slots; those of triangles that share a vertex and its normal share a slot.
struct Corners {
  std::span<const Vec3> position, normal;          ///< by slot, world; normals unit; the caller's
  std::vector<std::array<uint32_t, 3>> triangles;  ///< slots of the triangles that count; others have no say
};

struct Clusters {
  static constexpr uint32_t kNone = ~0u;
  std::vector<uint32_t> of;      ///< by slot; kNone: of no triangle
  std::vector<uint32_t> member;  ///< by cluster: the slot that stands for it, the nearest to their middle
};
/// Cubes of `spacing`, and 24 ways to face. In the order of first members. O(triangles).
Clusters clusterCorners(const Corners& corners, float spacing);
/// Their number, or some number above `most`.
size_t countClusters(const Corners& corners, float spacing, size_t most);

struct Stencil {
  std::array<uint32_t, 3> cluster{};
  std::array<float, 3> weight{1.0f, 0.0f, 0.0f};  ///< sum 1
};
/// By slot. Where a cluster's point is, it alone; elsewhere the inverse distances (Franke & Little's, to two spacings) to it and to clusters that share a
/// triangle with it, by how much they face the same way.
std::vector<Stencil> stencils(const Corners& corners, const Clusters& clusters, float spacing);

}  // namespace gobo::transfer

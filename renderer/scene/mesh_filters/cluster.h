// SPDX-License-Identifier: Apache-2.0
// Vertex clustering: all points in a cube of a lattice become one, and triangles with two corners in one cube go (Rossignac, Borrel 1993). Which one:
// the least sum of squared distances from the planes of the triangles that touch the cube, weighted by squared area (Lindstrom 2000), and of the walls
// through edges of the rim (Garland, Heckbert 1997), so that edges, corners and rims of flat pieces stay where they are. It never leaves its cube.
#pragma once

#include "scene/mesh_filters/weld.h"

namespace gobo {
inline namespace scene {

struct VertexClusters {
  double side = 0.0;                  ///< m
  std::vector<uint32_t> of;           ///< one a point: its cube; kNoPoint where no triangle has it
  std::vector<DVec3> centre;          ///< one a cube
  std::vector<DVec3> representative;  ///< one a cube, within it; the point itself, to the bit, where there is one alone
};

/// Cubes in axes of the object with the object's origin in the middle of one: they stay with it when it moves. Of less than 2^-52 of the farthest
/// coordinate: each point has its own. O(triangles). False after `stop`.
bool clusterPoints(const WeldedMesh& mesh, const PointGraph& graph, double side, const StopToken& stop, VertexClusters& out);

/// The triangles whose corners are in three cubes, once each (of equal ones that face the same way the first; a sheet folded onto its back keeps both
/// sides). Vertices of a cube that edges inside of it join become one, with the mean of their attributes, weighted by area: sides of a seam or of a
/// crease stay apart. A mesh without attributes has one vertex a cube. `mesh` and `welded` become those that are left. False after `stop`.
bool mergeClusters(const VertexClusters& clusters, Mesh& mesh, WeldedMesh& welded, const StopToken& stop);

}  // namespace scene
}  // namespace gobo

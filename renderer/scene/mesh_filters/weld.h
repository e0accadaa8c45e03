// SPDX-License-Identifier: Apache-2.0
// A mesh as points: vertices of one position, but for rounding, are one point, so that what moves a point moves all of its vertices to the same bits.
#pragma once

#include <vector>

#include "base/stop.h"
#include "scene/mesh_view.h"

namespace gobo {
inline namespace scene {

inline constexpr uint32_t kNoPoint = ~0u;

struct WeldedMesh {
  std::vector<uint32_t> indices;  ///< 3 a triangle, of vertices
  std::vector<uint32_t> pointOf;  ///< one a vertex
  std::vector<Vec3> rest;         ///< one a point: where one of its vertices is in the object's coordinates
  std::vector<DVec3> points;      ///< metres: stretch * rest until a filter moves them
  size_t triangles() const { return indices.size() / 3; }
  uint32_t corner(size_t triangle, int k) const { return pointOf[indices[3 * triangle + size_t(k)]]; }
};

/// Of the largest coordinate of a mesh: places closer than this along each axis are one. Four units in the last place, since a corner that faces reach
/// by sums of their own is rounded on its own (built-in boxes are made so).
inline constexpr double kWeldTolerance = 0x1p-21;

/// A vertex joins the first point that is within the tolerance, or is a point. False after `stop`.
bool weld(const Mesh& mesh, const glm::dmat3& stretch, const StopToken& stop, WeldedMesh& out);

/// Who is next to whom along edges. At the rim of an open mesh (an edge of one triangle alone) neighbours are those along the rim, so that the
/// rim is smoothed as the curve that it is and is not drawn inwards.
struct PointGraph {
  std::vector<uint32_t> first;      ///< points + 1: of neighbours
  std::vector<uint32_t> neighbour;  ///< ascending for each point
  std::vector<uint32_t> rim;        ///< 2 a rim edge, of points, in the direction of its triangle
  std::vector<uint32_t> rimOf;      ///< its triangle
};
/// Triangles with two corners in one point have no say. O(triangles). False after `stop`.
bool connect(const WeldedMesh& mesh, const StopToken& stop, PointGraph& out);

/// Unit normals of points, weighted by the angles of their triangles, which does not depend on how faces are cut into triangles (Thuermer, Wuethrich
/// 1998; Baerentzen, Aanaes 2005). Zero where nothing has an area or all cancels. False after `stop`.
bool pointNormals(const WeldedMesh& mesh, const StopToken& stop, std::vector<DVec3>& out);

/// What a corner adds to a normal there: the triangle's unit normal times its angle; zero if the triangle has no area.
DVec3 cornerNormal(const DVec3& at, const DVec3& next, const DVec3& last);

}  // namespace scene
}  // namespace gobo

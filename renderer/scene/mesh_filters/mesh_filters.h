// SPDX-License-Identifier: Apache-2.0
// Filters of meshes: simplified by vertex clustering, then smoothed, then inflated. The geometric counterpart of stylised shadows (DeCoro 2009, 2.2 and
// figures 1.13, 3.9) and a level of detail by itself. docs/mesh_filters.md is the manual.
//
// Vertices of one position are one point to every filter (weld.h), so seams of texture coordinates and of creases do not open.
#pragma once

#include <memory>

#include "base/status.h"
#include "base/stop.h"
#include "scene/mesh_view.h"

namespace gobo {
inline namespace scene {

using MeshPtr = std::shared_ptr<const Mesh>;

enum class MeshSmoothing : uint8_t { Laplacian, Taubin };

/// Largest step of Taubin's filter: above it the shortest waves that a mesh can have grow with every pass (smooth.h).
inline constexpr double kLargestTaubinStep = 0.69;

struct MeshFilter {
  double cluster = 0.0;  ///< side of the cubes whose vertices become one, m; 0: none
  uint32_t smooth = 0;   ///< passes; 0: none
  MeshSmoothing smoothing = MeshSmoothing::Taubin;
  double step = 0.5;        ///< share of the way to the neighbours' mean, 0 .. 1 (Taubin: kLargestTaubinStep)
  double inflate = 0.0;     ///< m, out along the normals; negative: in
  glm::dmat3 stretch{1.0};  ///< positions times this are in metres, in axes of the object: stretchOf(toWorld)
  bool identity() const { return !(cluster > 0.0) && (smooth == 0 || step == 0.0) && inflate == 0.0; }
};

/// The symmetric factor S of a transform's linear part M = R S (polar decomposition, R orthogonal): lengths, angles and areas of S p are those of the
/// object in the world, whichever way it is turned, mirrored or moved, so that a filtered object keeps its mesh while it moves rigidly. Entries are
/// rounded to about 2^-17 of the largest one, which takes the rounding of a rotation out; not of objects with an axis below 2^-12 of the longest. Axes below
/// 1e-7 of it count as that.
glm::dmat3 stretchOf(const Mat4& toWorld);

struct FilteredMesh {
  enum class End : uint8_t {
    Made,
    Clustered,  ///< away: no triangle had its corners in three cubes
    Smoothed,   ///< away: no triangle has an area any more
    Beyond,     ///< a vertex is farther than kLargestCoordinate from the object's origin
  };
  End end = End::Made;
  MeshPtr mesh;  ///< sealed; null unless Made. The given one where it has no triangle of some area, or nothing changes
};

/// Same arrays as `mesh` (an empty one stays empty), its material and name. O(triangles) each for weld, clusters and normals, O(smooth * edges) for
/// passes; docs/mesh_filters.md has times. One thread, float64 inside; every loop polls `stop`: Cancelled.
Result<FilteredMesh> filterMesh(const MeshPtr& mesh, const MeshFilter& filter, const StopToken& stop = {});

}  // namespace scene
}  // namespace gobo

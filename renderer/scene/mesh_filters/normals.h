// SPDX-License-Identifier: Apache-2.0
// What becomes of shading normals and tangents when points move: they turn as the surface under them turns, so that smooth stays smooth, creases stay
// creases, and what an artist bent stays bent by as much.
#pragma once

#include <functional>

#include "scene/mesh_filters/weld.h"

namespace gobo {
inline namespace scene {

/// Vertices of one point whose normals differ by less than this share a side of the surface: 2.6 degrees, above the rounding of normals in 8 bits.
inline constexpr float kSameSide = 0.999f;
/// Means of unit vectors shorter than this have no direction.
inline constexpr double kLeastMeanDirection = 1e-6;

/// Calls join(a, b) for vertices of one point with similar normals, each with the first of its side. False after `stop`.
bool joinSimilarNormals(const Mesh& mesh, const WeldedMesh& welded, const std::function<void(uint32_t, uint32_t)>& join, const StopToken& stop);

/// v turned as the shortest rotation from `from` to `to` turns, unit vectors; mirrored at the origin where they are opposite, as a surface that was
/// turned inside out is.
DVec3 turned(const DVec3& v, const DVec3& from, const DVec3& to);

/// Turns normals and tangents of `mesh` from `before` (points) to welded.points: by the rotation between the angle-weighted normals of the triangles on
/// their side of the surface. A side without area, before or after, keeps what it has. Arrays that are empty stay so. False after `stop`.
bool turnNormals(Mesh& mesh, const WeldedMesh& welded, const std::vector<DVec3>& before, const glm::dmat3& stretch, const StopToken& stop);

}  // namespace scene
}  // namespace gobo

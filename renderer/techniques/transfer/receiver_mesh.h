// SPDX-License-Identifier: Apache-2.0
// Transfer points of a scene, and how a place on its surface is interpolated between them.
//   - Triangles are cut into n x n alike, n by their longest edge, so that points lie about a `spacing` apart; the spacing is the least (by steps of 20 %)
//     that stays within the number of points that is asked for. Triangles that are smaller have their vertices alone, however many these are.
//   - Vertices of meshes with normals are one point for all triangles about them that are not cut; cut triangles and those of flat meshes have their own, since
//     their edges are creases or may be.
//   - Both sides of double-sided materials have points.
//   - Points are drawn in by 5 % of a cell towards the triangles' middles, within the surface: a point on the very edge between two walls lies in
//     both, and its rays may begin behind the other.
// A place is a weighted mean of three points, continuous within each mesh but at edges where cells of different sizes meet.
// Immutable; any thread. O(triangles) to make; memory 9 bytes a triangle and 4 a vertex.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "scene/scene.h"

namespace gobo::transfer {

/// Three points (indices) and their weights, whose sum is 1.
struct Between {
  std::array<uint32_t, 3> point{};
  std::array<float, 3> weight{};
};

/// Points that are inside of something get no weight, unless all three are.
inline void leaveUnusable(std::span<const uint8_t> usable, Between& at) {
  float sum = 0;
  for (size_t k = 0; k < 3; ++k) sum += usable[at.point[k]] ? at.weight[k] : 0.0f;
  if (!(sum > 1e-6f)) return;
  for (size_t k = 0; k < 3; ++k) at.weight[k] = usable[at.point[k]] ? at.weight[k] / sum : 0.0f;
}

class ReceiverMesh {
 public:
  static constexpr Facet kFacets = Facet::Topology | Facet::Pose | Facet::Shading | Facet::Coverage;
  /// `view` allows kFacets and outlives this.
  ReceiverMesh(const SceneView& view, uint32_t points);
  size_t size() const { return size_; }
  float spacing() const { return spacing_; }  ///< world units; 0 where there is no triangle
  /// `front`: the side that triangles are counter-clockwise from. False: that side has no points.
  bool locate(uint32_t instance, uint32_t primitive, float u, float v, bool front, Between& out) const;

  struct Points {
    std::vector<Vec3> position, normal;  ///< world; normals unit, away from the side
    std::vector<uint32_t> instance, primitive;
    std::vector<Vec2> bary;   ///< a triangle that it lies in, and where
    std::vector<float> cell;  ///< size of what is about it, world units
  };
  Points points() const;

 private:
  struct Part {                     // an instance
    uint32_t first = 0, count = 0;  // points of the front
    bool both = false, welded = false;
    size_t vertices = 0;
    std::vector<float> longest;        // edges of triangles, world units
    std::vector<uint32_t> ofVertex;    // from `first`; ~0u: none
    std::vector<uint32_t> ofTriangle;  // from `first`: its own points begin here; ~0u: its vertices'
    std::vector<uint8_t> cuts;         // edges are cut into so many
  };
  static constexpr int kMostCuts = 128;
  template <typename Visit>
  void triangles(size_t instance, Visit&& visit) const;  // visit(triangle, a, b, c) in world space
  size_t count(float spacing) const;
  void lay(float spacing);
  static int cutsOf(float longest, float spacing);
  const SceneView& view_;
  float spacing_ = 0;
  size_t size_ = 0;
  std::vector<Part> parts_;
};

}  // namespace gobo::transfer

// SPDX-License-Identifier: Apache-2.0
// Transfer points of a scene, and how a place on its surface is interpolated between them.
//   - Triangles longer than a `spacing` are cut into strips along their longest edge and strips into pieces, so that points lie at most that apart along
//     each, however long and thin a triangle is. They have points of their own, since their edges are creases or may be.
//   - Corners of smaller triangles are thinned to about a point a spacing and way to face (receiver_clusters.h).
//   - The spacing is the least (by steps of 20 %) that stays within the number of points that is asked for.
//   - Both sides have points where both may be seen: of double-sided materials, of those with holes, and of meshes that are not closed or are inside out
//     (closed_mesh.h).
//   - Points are drawn in by some per cent of a cell towards the triangles' middles, within the surface: a point on the very edge between two walls lies in
//     both, and its rays may begin behind the other.
// A place is a weighted mean of at most kCorners points: on triangles that are cut, linear between the points of a row and between rows (linear functions are
// kept). Continuous within each mesh but at edges where cells of different sizes meet.
#pragma once

#include <array>
#include <memory>
#include <span>
#include <vector>

#include "scene/scene.h"
#include "techniques/transfer/receiver_clusters.h"

namespace gobo::transfer {

inline constexpr size_t kCorners = 6;
/// Points (indices) and their weights, whose sum is 1; those that are not needed have weight 0.
struct Between {
  std::array<uint32_t, kCorners> point{};
  std::array<float, kCorners> weight{};
};

/// Points that are inside of something get no weight, unless all are.
inline void leaveUnusable(std::span<const uint8_t> usable, Between& at) {
  float sum = 0;
  for (size_t k = 0; k < kCorners; ++k) sum += usable[at.point[k]] ? at.weight[k] : 0.0f;
  if (!(sum > 1e-6f)) return;
  for (size_t k = 0; k < kCorners; ++k) at.weight[k] = usable[at.point[k]] ? at.weight[k] / sum : 0.0f;
}

/// Immutable; any thread. Memory: some 20 bytes a triangle and 24 a vertex.
class ReceiverMesh {
 public:
  static constexpr Facet kFacets = Facet::Topology | Facet::Pose | Facet::Shading | Facet::Coverage;
  /// `view` allows kFacets. O(triangles), some times.
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
  /// Of the scene that this was made of.
  Points points(const SceneView& view) const;

 private:
  struct Size {
    float longest, height;  // edge, and height above it, world units
    uint8_t edge;           // from corner `edge` to the next
  };
  /// How triangles of some proportions are cut: row 0 is the longest edge in `pieces`, and each of the `strips` rows behind it one of fewer, down to the
  /// corner.
  struct Pattern {
    int strips = 1, pieces = 1, edge = 0;
    std::vector<uint32_t> row;  // number of its first point, and of all
    /// Of row j: as many pieces as keep them no longer than those of row 0.
    int in(int j) const { return (pieces * (strips - j) + strips - 1) / strips; }
  };
  struct Triangle {
    uint32_t own = 0;      // cut: its own points begin here, from Part::first; else its number in corners_
    uint16_t pattern = 0;  // of patterns_; 0: not cut
  };
  struct Part {                     // an instance
    uint32_t first = 0, count = 0;  // points of the front
    size_t triangle = 0;            // its first of triangles_
    size_t slot = 0;                // its first of stencils_
    bool both = false;
    std::vector<uint32_t> member;  // slots of its clusters, whose points come first
  };
  struct Source;  // of a part while this is made
  static constexpr int kMostCuts = 128;
  static int cutsOf(float length, float spacing);
  static size_t pointsOf(int strips, int pieces);
  static Source sourceOf(const SceneView& view, size_t instance, bool both);
  static Corners small(const Source& source, float spacing);
  uint16_t patternOf(const Size& size, float spacing);
  float spacing_ = 0;
  size_t size_ = 0;
  std::vector<Part> parts_;
  std::vector<Triangle> triangles_;
  std::vector<std::array<uint32_t, 3>> corners_;  // slots, from their part's first
  std::vector<Stencil> stencils_;                 // clusters of their part
  std::vector<Pattern> patterns_;                 // 0: none
  std::vector<uint16_t> patternFor_;              // by edge, strips and pieces; 0: not made
};

/// Made once while the last two are: a plan's nodes and the next plan's share it.
std::shared_ptr<const ReceiverMesh> receiverMesh(const SceneView& view, uint32_t points);

}  // namespace gobo::transfer

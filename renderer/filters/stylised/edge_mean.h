// SPDX-License-Identifier: Apache-2.0
// What holds at a shadow's edge, spread over the surface: the mean of a value over the edge with weights |x - y|^-8 (DeCoro's L_8 average, of values instead of
// distances), so that each place has the value of the edge that it is near to, and it changes smoothly between two.
//
// Inputs       0: "occluder_distance", planes d and instance (terms/occluder_distance.h), d -1 where unknown; 1: the visibility that it is of (plane V); 2:
// "gbuffer". Output       term "style_occluder", domain ViewSample, plane d f32, metres: at least the least and at most the largest of what the edge has; 0
// where no edge is seen and
//              where nothing is hit; and for each set of casters a plane (edgeCasterPlane) f32: the share of the edge near by that they cast.
// Parameters   angle: edges whose normals differ by more are not seen. casters: at most 3 sets of instances.
// Error        Pieces of edge count as one where that moves the mean by less than a thousandth of the spread of its values, and what is 6 times as far as the
// nearest
//              not at all: tests hold the whole to 1 % of the spread.
// Cost         A tree over the edge's points (one thread), then some tens of its nodes a sample.
// Determinism  bit-identical for any number of threads.
#pragma once

#include <array>
#include <vector>

#include "terms/node.h"

namespace gobo {
inline namespace filters {

struct EdgeMeanSettings {
  Extent extent;
  float angle = 0.78539816f;                     ///< radians
  std::vector<std::vector<uint32_t>> casters{};  ///< each increasing
};
inline constexpr size_t kEdgeValues = 4;  ///< distance and three casters
const char* edgeCasterPlane(int caster);
NodePtr makeEdgeMeanNode(const EdgeMeanSettings& settings);

/// A point of an edge.
struct EdgePoint {
  Vec3 at{0.0f}, normal{0.0f};
  float length = 0;
  std::array<float, kEdgeValues> values{};
};
/// The mean of the first value at x with normal n; 0 where no point is seen. For tests: term by term, without a tree.
double edgeMeanAt(const std::vector<EdgePoint>& edge, const Vec3& x, const Vec3& n, float cosine);

}  // namespace filters
}  // namespace gobo

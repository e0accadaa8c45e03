// SPDX-License-Identifier: Apache-2.0
// What holds at a shadow's edge, spread over the surface: the mean of a value over the edge with weights |x - y|^-8 (DeCoro's L_8 average, of values instead of
// distances), so that each place has the value of the edge that it is near to, and it changes smoothly between two.
//
// Inputs       0: "occluder_distance", plane d (terms/occluder_distance.h), -1 where unknown; 1: the visibility that it is of (plane V); 2: "gbuffer".
// Output       term "style_distance_to_occluder", domain ViewSample, plane d f32, metres: at least the least and at most the largest of what the edge has; 0 where no
//              edge is seen and where nothing is hit.
// Parameters   angle: edges whose normals differ by more are not seen.
// Error        Pieces of edge count as one where that moves the mean by less than a thousandth of the spread of its values, and what is 6 times as far as the nearest
//              not at all: tests hold the whole to 1 % of the spread.
// Cost         A tree over the edge's points (one thread), then some tens of its nodes a sample.
// Determinism  bit-identical for any number of threads.
#pragma once

#include "terms/node.h"

namespace gobo {

struct EdgeMeanSettings {
  Extent extent;
  float angle = 0.78539816f;  ///< radians
};
NodePtr makeEdgeMeanNode(const EdgeMeanSettings& settings);

/// A point of an edge.
struct EdgePoint {
  Vec3 at{0.0f}, normal{0.0f};
  float length = 0, value = 0;
};
/// The mean at x with normal n; 0 where no point is seen. For tests: term by term, without a tree.
double edgeMeanAt(const std::vector<EdgePoint>& edge, const Vec3& x, const Vec3& n, float cosine);

}  // namespace gobo

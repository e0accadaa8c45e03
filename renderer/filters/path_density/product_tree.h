// SPDX-License-Identifier: Apache-2.0
// k nearest neighbours in the metric of path density by a k-d tree whose boxes bound both norms: |film| + |colour| of the way into the box. With epsilon > 0 a
// branch is left out when (1 + epsilon) times its bound is beyond the k-th nearest so far (Arya et al. 1998): the j-th that is found is at most
// (1 + epsilon) times as far as the j-th nearest. Distances come out too large, densities too small: more is rejected. The baseline of NeighbourSearch.
// Memory: 12 bytes a sample and some 6 for nodes. Building: O(N log N) on one thread.
#pragma once

#include <vector>

#include "filters/path_density/neighbour_search.h"

namespace gobo::pathdensity {

/// Reads points, which must live as long. Thread-safe.
class ProductTree {
 public:
  explicit ProductTree(const MetricPoints& points);
  /// The k nearest others of point i, or all, nearest first. Ties by index where epsilon is 0. Returns how many points were looked at.
  size_t nearest(size_t i, int k, float epsilon, std::vector<Neighbour>& out) const;

 private:
  struct Node {
    float lo[5], hi[5];
    uint32_t begin = 0, end = 0;  ///< of ids_
    uint32_t right = 0;           ///< the left child comes next; 0: a leaf
  };
  struct Query;
  uint32_t build(uint32_t begin, uint32_t end);
  void descend(uint32_t node, float bound, Query& query) const;
  static float boundOf(const Node& node, const MetricPoint& q);

  const MetricPoints& points_;
  std::vector<uint32_t> ids_;
  std::vector<Node> nodes_;
};

}  // namespace gobo::pathdensity

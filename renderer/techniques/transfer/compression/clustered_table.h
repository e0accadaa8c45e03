// SPDX-License-Identifier: Apache-2.0
// Tables of transfer in fewer bytes (row 18 of the source; Sloan, Hall, Hart, Snyder 2003, "Clustered Principal Components for Precomputed Radiance Transfer").
// A table is `rows` vectors of `width` floats: of a transfer point the harmonics of its direct transfer, or 3 x harmonics of the bounced one (nodes.h).
//   HalfTable       every number in binary16 with one power of two for the table: half the bytes, 2^-11 of a number's size
//   ClusteredTable  points in clusters; of a cluster its mean and the first principal directions, of a point its cluster and its weights by them in binary16
// Clusters come from k-means over seeded centres, then change hands while that lowers what principal directions leave (the paper's iterative CPCA). Both are
// of any unit: weights are stored by the distance of their cluster's farthest row. Sums are in double, of a cluster's rows in their order: the same bits for
// any number of threads.
//
// Error. `bound[c]` is the largest Euclidean distance between a row of cluster c and what row() gives for it, everything rounded; so under a map of
// coefficients m the light of a point of that cluster is off by |m| x bound at most (Cauchy-Schwarz). `squared[c]`: the sum of squared distances. Without
// rounding that is the sum of the second moments' eigenvalues that were left out: `discarded[c]`, known before a row is written. All are measured on what row()
// returns, so they hold bit for bit for what a reader gets.
// Nothing stores tables this way: bench/transfer_compression_bench says what they cost and keep (docs/environment.md).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/status.h"
#include "base/stop.h"
#include "base/task_arena.h"

namespace gobo::transfer {

struct HalfTable {
  size_t width = 0;
  int exponent = 0;  ///< numbers are halves x 2^exponent
  std::vector<uint16_t> values;
  double bound = 0;  ///< largest distance of a row

  size_t rows() const { return width > 0 ? values.size() / width : 0; }
  size_t bytes() const { return 2 * values.size(); }
  void row(size_t i, std::span<float> out) const;
};
/// Errors: InvalidArgument for numbers that are not finite or beyond 1e30, or a size that is no multiple of `width`.
Result<HalfTable> halfTable(std::span<const float> table, size_t width, const TaskArena& arena);

struct ClusterSettings {
  size_t clusters = 64;  ///< 1 .. 65536, at most; no more than rows
  size_t kept = 8;       ///< principal directions of each, 0 .. width (more: width)
  int means = 12;        ///< rounds of k-means, at most
  int exchanges = 6;     ///< rounds in which rows go to the cluster whose directions leave least of them, at most
  uint64_t seed = 0;
};

struct ClusteredTable {
  size_t width = 0, kept = 0;
  std::vector<uint16_t> cluster;       ///< by row
  std::vector<uint16_t> weights;       ///< rows x kept, halves, by scale of the cluster
  std::vector<float> mean, scale;      ///< clusters x width; clusters
  std::vector<uint16_t> directions;    ///< clusters x kept x width, halves
  std::vector<double> bound, squared;  ///< by cluster, of what row() gives
  std::vector<double> discarded;       ///< by cluster: sum of squared distances that the left-out directions cost, without rounding

  size_t rows() const { return cluster.size(); }
  size_t clusters() const { return scale.size(); }
  /// Of what row() needs; cluster numbers count one byte where there are at most 256 clusters, and none for one.
  size_t bytes() const;
  void row(size_t i, std::span<float> out) const;
};
/// Empty (`width` 0) if `stop` fired first. A cluster that no row is nearest to is left out. Errors: as halfTable.
Result<ClusteredTable> clusteredTable(std::span<const float> table, size_t width, const ClusterSettings& settings, const TaskArena& arena,
                                      const StopToken& stop = {});

}  // namespace gobo::transfer

// SPDX-License-Identifier: Apache-2.0
// Exact k nearest neighbours in the metric of path density (metric.h), by cells of the film: rings of cells around the sample are looked at, outwards, until
// the distance on the film alone proves that no nearer sample can come. Where only an outcome is asked for it ends as soon as that is proven:
//   mean <= accept   as k samples nearer than that are known,
//   mean >= reject   as the known ones, and the rest at the distance of what has not been looked at, have that mean at least.
// Cost: some 2.5 ns a sample looked at; in even light about 3 x 3 cells of them. A sample that none resembles costs up to (2 reject + 3)^2 pixels of
// samples, more where nearly k others resemble it. Memory: the distances of one sample's neighbours, per thread.
#pragma once

#include <limits>
#include <vector>

#include "filters/path_density/distances.h"
#include "filters/path_density/metric.h"

namespace gobo::pathdensity {

struct Neighbour {
  float distance = 0;
  uint32_t sample = 0;  ///< in the points' order
  /// By distance, then by index.
  bool operator<(const Neighbour& o) const { return distance < o.distance || (distance == o.distance && sample < o.sample); }
  bool operator==(const Neighbour&) const = default;
};

/// What may be said of a mean distance without knowing it: any value <= accept stands for one of these, any >= reject likewise.
struct OutcomeBounds {
  float accept = -1.0f;
  float reject = std::numeric_limits<float>::infinity();
};

/// Reads points and bins, which must live as long. Thread-safe.
class NeighbourSearch {
 public:
  NeighbourSearch(const SampleBins& bins, const MetricPoints& points, float filmScale);

  struct Scratch {
    std::vector<float> distances, nearer;
    std::vector<Neighbour> neighbours;
  };
  /// Mean distance of point i to its k nearest others, exact between the bounds; to all others where there are fewer than k, 0 where there is none.
  float meanDistance(size_t i, int k, const OutcomeBounds& bounds, Scratch& scratch) const;
  /// The k nearest others of point i, or all, nearest first. Ties by index.
  void nearest(size_t i, int k, std::vector<Neighbour>& out, Scratch& scratch) const;

 private:
  template <class Visit>
  void visitRing(int cx, int cy, int ring, Visit&& visit) const;
  float unseen(const MetricPoint& q, int cx, int cy, int ring) const;

  const SampleBins& bins_;
  const MetricPoints& points_;
  float perPixel_;
  std::vector<uint8_t> firstRings_;  ///< by k
};

}  // namespace gobo::pathdensity

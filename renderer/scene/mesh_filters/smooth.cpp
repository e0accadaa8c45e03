// SPDX-License-Identifier: Apache-2.0
#include "scene/mesh_filters/smooth.h"

#include "scene/mesh_filters/numbering.h"

namespace gobo {
inline namespace scene {

bool smoothPoints(std::vector<DVec3>& points, const PointGraph& graph, uint32_t passes, double step, double out, const StopToken& stop) {
  std::vector<DVec3> moved(points.size());
  const auto move = [&](double share) {
    for (size_t i = 0; i < points.size(); ++i) {
      if (i % kFilterPoll == 0 && stop.stopRequested()) return false;
      const uint32_t first = graph.first[i], end = graph.first[i + 1];
      DVec3 sum(0.0);  // of differences: far from the origin no digits are lost
      for (uint32_t k = first; k < end; ++k) sum += points[graph.neighbour[k]] - points[i];
      moved[i] = first == end ? points[i] : points[i] + sum * (share / double(end - first));
    }
    points.swap(moved);
    return true;
  };
  for (uint32_t pass = 0; pass < passes; ++pass)
    if (!move(step) || (out != 0.0 && !move(-out))) return false;
  return true;
}

}  // namespace scene
}  // namespace gobo

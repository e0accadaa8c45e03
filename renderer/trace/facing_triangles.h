// SPDX-License-Identifier: Apache-2.0
// FacingTriangles: the choice among the few triangles of a one-sided lamp. Half of a closed lamp always faces away from a receiver;
// samples on that half are wasted, which on a Cornell box lit by a thin box doubles the variance of its direct light. Exact: a triangle
// is chosen in proportion to its weight among those whose front the receiver sees, 0 otherwise. O(triangles) a choice.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/vec.h"

namespace gobo {
inline namespace trace {

class FacingTriangles {
 public:
  /// With more triangles than this the search costs more than the samples that it saves.
  static constexpr size_t kMost = 16;

  /// A triangle through `point` with unit normal `n` and a weight >= 0. They are numbered as they come.
  void add(const Vec3& point, const Vec3& n, double weight) { planes_.push_back({DVec3(n), glm::dot(DVec3(point), DVec3(n)), weight}); }
  bool empty() const { return planes_.empty(); }
  void clear() { planes_.clear(); }

  /// Does p see the front of triangle k?
  bool faces(uint32_t k, const DVec3& p) const { return glm::dot(planes_[k].n, p) > planes_[k].offset; }
  /// Weight of all whose front p sees.
  double mass(const DVec3& p) const {
    double sum = 0;
    for (uint32_t k = 0; k < planes_.size(); ++k)
      if (faces(k, p)) sum += planes_[k].weight;
    return sum;
  }
  /// By u in [0, 1), which becomes the place within the share of the chosen one. `all` = mass(p), which must be above 0.
  uint32_t pick(const DVec3& p, double all, float& u) const {
    double left = double(u) * all, weight = 0;
    uint32_t chosen = 0;
    for (uint32_t k = 0; k < planes_.size(); ++k) {
      if (!faces(k, p) || !(planes_[k].weight > 0)) continue;
      if (weight > 0) left -= weight;  // of the one before
      chosen = k;
      weight = planes_[k].weight;
      if (left < weight) break;
    }
    u = float(std::clamp(left / weight, 0.0, 1.0));
    return chosen;
  }

 private:
  struct Plane {
    DVec3 n;
    double offset, weight;
  };
  std::vector<Plane> planes_;
};

}  // namespace trace
}  // namespace gobo

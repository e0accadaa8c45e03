// SPDX-License-Identifier: Apache-2.0
// PhotonMap: the photons of one pass, in grid cells, for look-ups within one radius. Photons of a cell stay in the order that
// they came in, and cells are visited in a fixed order: a sum over a look-up has the same bits whatever the threads.
// Immutable after build; any thread may look up. Build: one sort, O(n log n); 60 bytes a photon. Look-up: 8 cells of 2 r.
#pragma once

#include <cstdint>
#include <vector>

#include "base/vec.h"

namespace gobo {
inline namespace trace {

struct Photon {
  Vec3 p;              ///< where it landed
  Vec3 toLight;        ///< unit, against its direction of travel
  Vec3 n;              ///< outside geometric normal there
  Vec3 flux;           ///< W by channel
  int32_t slot = 0;    ///< group of its light
  int32_t events = 0;  ///< scattering events behind it, all by delta lobes
};

class PhotonMap {
 public:
  PhotonMap() = default;
  /// radius > 0, metres. Photons at non-finite places or with non-finite flux are left out.
  PhotonMap(std::vector<Photon> photons, float radius);
  size_t size() const { return photons_.size(); }
  float radius() const { return radius_; }
  const std::vector<Photon>& photons() const { return photons_; }

  /// Calls visit(photon) for every photon within the radius of p.
  template <typename Visit>
  void around(const Vec3& p, Visit&& visit) const {
    if (photons_.empty()) return;
    int64_t lo[3];
    for (int c = 0; c < 3; ++c) lo[c] = cell(p[c] - radius_, c);
    const float r2 = radius_ * radius_;
    for (int k = 0; k < 8; ++k) {  // a ball of radius r meets at most two cells of 2 r on each axis
      const int64_t at[3] = {lo[0] + (k & 1), lo[1] + (k >> 1 & 1), lo[2] + (k >> 2 & 1)};
      const Cell* found = find(at);
      if (!found) continue;
      for (uint32_t i = found->begin; i < found->end; ++i) {
        const Vec3 d = photons_[i].p - p;
        if (glm::dot(d, d) <= r2) visit(photons_[i]);
      }
    }
  }

 private:
  struct Cell {
    uint64_t key = ~0ull;
    uint32_t begin = 0, end = 0;
  };
  static constexpr int64_t kMost = (1 << 21) - 1;  // 21 bits an axis; what is beyond shares the last cell
  int64_t cell(float x, int axis) const {
    const double k = std::floor((double(x) - origin_[axis]) * perCell_);
    return !(k >= -1.0) ? -1 : k > double(kMost) ? kMost : int64_t(k);  // what is no number is nowhere
  }
  const Cell* find(const int64_t at[3]) const;
  std::vector<Photon> photons_;  // by cell
  std::vector<Cell> table_;      // open addressing, a power of two
  DVec3 origin_{0.0};
  double perCell_ = 0;
  float radius_ = 0;
};

}  // namespace trace
}  // namespace gobo

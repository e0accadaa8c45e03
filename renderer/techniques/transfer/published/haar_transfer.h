// SPDX-License-Identifier: Apache-2.0
// Direct transfer in Haar wavelets: the rival of harmonics and lights that keeps all frequencies (Ng, Ramamoorthi, Hanrahan 2003, "All-frequency shadows using
// non-linear wavelet lighting approximation"; digest of seed 004, chapter 8), to measure ours beside. Nothing here renders.
// Each transfer point looks along the middle of every cell of a cube map once. What the cell would give it, with V of that ray,
//   T_cell(p) = V(p, middle) max(0, n . integral of w over the cell)        W/m^2 of radiance 1
// goes into wavelets (cube_wavelets.h), and so does the map; irradiance is the sum of products of terms, of which the K largest of the map are taken:
// another K for each map, so that all of the transfer has to be kept. It is kept by wavelet, so that light costs what its K terms have. No sample
// is drawn: what errs is the cell (its one ray, and that a map has its mean there), then K. In the world's axes, no albedo.
#pragma once

#include <span>
#include <vector>

#include "base/stop.h"
#include "base/task_arena.h"
#include "scene/environment.h"
#include "techniques/transfer/published/cube_wavelets.h"
#include "techniques/transfer/published/haar.h"
#include "terms/term.h"
#include "trace/accel.h"

namespace gobo::transfer::published {

/// Cells of a cube with their geometry, cut by planes through the middle: edges are great circles. Directions and faces as EnvironmentCells'.
class HaarCells {
 public:
  /// Errors: InvalidArgument unless `side` is 1, 2, 4 .. 64.
  static Result<HaarCells> of(int side);
  const CubeWavelets& wavelets() const { return wavelets_; }
  const std::vector<Vec3>& middles() const { return middles_; }       ///< unit
  const std::vector<DVec3>& integrals() const { return integrals_; }  ///< of the direction over the cell, sr: what a facing plane gets of radiance 1

 private:
  explicit HaarCells(int side);
  CubeWavelets wavelets_;
  std::vector<Vec3> middles_;
  std::vector<DVec3> integrals_;
};

enum class HaarOrder {
  Largest,  ///< by luminance: the least squared error of the map
  ByArea,   ///< times the root of the wavelet's solid angle: the most that it can give to a place (its integral without sign is no more than that)
};
/// The map as it is turned, in wavelets, sorted; of equals the lower index. Each cell's mean is of directions half a texel apart or closer (4 to 64 across),
/// weighed by their solid angles. W/m^2/sr times the root of sr. Empty if `stop` fired first.
std::vector<HaarTerm> haarLight(const HaarCells& cells, const Environment& map, HaarOrder order, const TaskArena& arena, const StopToken& stop = {});

class HaarTransfer {
 public:
  /// `points`: term "transfer_points" (nodes.h) of the scene of `accel`. Terms below `drop` (0: none but zeros) of a point's Euclidean norm are left out.
  /// One ray a point and cell above its horizon. Errors: InvalidArgument for a `drop` that is not 0 <= drop < 1; Cancelled.
  static Result<HaarTransfer> of(const HaarCells& cells, const Term& points, const Accel& accel, double drop, const TaskArena& arena,
                                 const StopToken& stop = {});
  /// W/m^2 at each point, of these terms of the map. May be below 0 where they are not all. O(what is kept of them).
  std::vector<DVec3> irradiance(std::span<const HaarTerm> terms) const;
  size_t points() const { return points_; }
  size_t kept() const { return entries_.size(); }
  size_t bytes() const { return entries_.size() * sizeof(Entry) + first_.size() * sizeof(size_t); }
  uint64_t rays() const { return rays_; }

 private:
  struct Entry {
    uint32_t point;
    float value;
  };
  size_t points_ = 0;
  uint64_t rays_ = 0;
  std::vector<Entry> entries_;  // by wavelet, then by point
  std::vector<size_t> first_;   // of a wavelet; and the end
};

}  // namespace gobo::transfer::published

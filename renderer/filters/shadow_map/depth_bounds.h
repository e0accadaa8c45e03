// SPDX-License-Identifier: Apache-2.0
// DepthBounds: reading the pyramid of smallest and largest depth ("depth_bounds"): what a kernel can possibly meet. The Z-Max texture of
// exponential maps (thesis 7.3.1) and the hierarchical z-buffer (Greene 1993) are the same thing.
#pragma once

#include <algorithm>
#include <bit>
#include <span>

#include "filters/shadow_map/shadow_map.h"

namespace gobo {

class DepthBounds {
 public:
  static constexpr int kMaxLevels = 15;
  DepthBounds(const Term& term, int resolution);
  int resolution() const { return resolution_; }
  /// Level 0: the depth map of a face.
  const float* depth(int face) const { return lo_ + size_t(face) * faceTexels_; }
  struct Level { const float *lo, *hi; int side; };
  /// One level of the first face; the others follow at multiples of faceTexels().
  Level level(int l) const { return {lo_ + offset_[l], hi_ + offset_[l], side_[l]}; }
  int levels() const { return mipLevels(resolution_); }
  size_t faceTexels() const { return faceTexels_; }
  /// Bounds over texels [x0, x1] x [y0, y1] (inside the map), from the finest level at which they span at most two texels a side: never
  /// narrower than the truth.
  void range(int face, int x0, int y0, int x1, int y1, float& lo, float& hi) const {
    int level = std::max(int(std::bit_width(unsigned(std::max(x1 - x0, y1 - y0)))) - 1, 0);   // one finer spans three at least
    while ((x1 >> level) - (x0 >> level) > 1 || (y1 >> level) - (y0 >> level) > 1) ++level;
    const size_t base = size_t(face) * faceTexels_ + offset_[level], side = size_t(side_[level]);
    const size_t ax = size_t(x0 >> level), bx = size_t(x1 >> level), ay = base + size_t(y0 >> level) * side, by = base + size_t(y1 >> level) * side;
    lo = least(least(lo_[ay + ax], lo_[ay + bx]), least(lo_[by + ax], lo_[by + bx]));
    hi = most(most(hi_[ay + ax], hi_[ay + bx]), most(hi_[by + ax], hi_[by + bx]));
  }

 private:
  static float least(float a, float b) { return a < b ? a : b; }
  static float most(float a, float b) { return a > b ? a : b; }
  const float *lo_, *hi_;
  size_t faceTexels_;
  int resolution_;
  size_t offset_[kMaxLevels];
  int side_[kMaxLevels];
};

}  // namespace gobo

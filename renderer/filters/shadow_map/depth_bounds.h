// SPDX-License-Identifier: Apache-2.0
// DepthBounds: reading the pyramid of smallest and largest depth ("depth_bounds"): what a kernel can possibly meet. The Z-Max texture of
// exponential maps (thesis 7.3.1) and the hierarchical z-buffer (Greene 1993) are the same thing.
#pragma once

#include <algorithm>
#include <bit>
#include <span>

#include "filters/shadow_map/shadow_map.h"

namespace gobo {
inline namespace filters {

class DepthBounds {
 public:
  /// Floats of a face: the depth map, then levels 1 and up of the smallest depth, then of the largest.
  static size_t faceSize(int resolution) {
    const size_t square = size_t(resolution) * size_t(resolution);
    return square + 2 * (mipTexels(resolution) - square);
  }
  static Extent extent(int resolution, int faces) { return {int(faceSize(resolution)), 1, faces}; }
  static constexpr int kMaxLevels = 15;
  DepthBounds(const Term& term, int resolution);
  int resolution() const { return resolution_; }
  /// Level 0: the depth map of a face.
  const float* depth(int face) const { return texels_ + size_t(face) * faceTexels_; }
  struct Level {
    const float *lo, *hi;
    int side;
  };
  /// One level of the first face; the others follow at multiples of faceTexels().
  Level level(int l) const { return {texels_ + lo_[l], texels_ + hi_[l], side_[l]}; }
  int levels() const { return mipLevels(resolution_); }
  size_t faceTexels() const { return faceTexels_; }
  /// Bounds over texels [x0, x1] x [y0, y1] (inside the map), from the finest level at which they span at most two texels a side: never
  /// narrower than the truth.
  void range(int face, int x0, int y0, int x1, int y1, float& lo, float& hi) const {
    int level = std::max(int(std::bit_width(unsigned(std::max(x1 - x0, y1 - y0)))) - 1, 0);  // one finer spans three at least
    while ((x1 >> level) - (x0 >> level) > 1 || (y1 >> level) - (y0 >> level) > 1) ++level;
    const float* base = texels_ + size_t(face) * faceTexels_;
    const float *low = base + lo_[level], *high = base + hi_[level];
    const size_t side = size_t(side_[level]), ax = size_t(x0 >> level), bx = size_t(x1 >> level), ay = size_t(y0 >> level) * side,
                 by = size_t(y1 >> level) * side;
    lo = least(least(low[ay + ax], low[ay + bx]), least(low[by + ax], low[by + bx]));
    hi = most(most(high[ay + ax], high[ay + bx]), most(high[by + ax], high[by + bx]));
  }

 private:
  static float least(float a, float b) { return a < b ? a : b; }
  static float most(float a, float b) { return a > b ? a : b; }
  const float* texels_;
  size_t faceTexels_;
  int resolution_;
  size_t lo_[kMaxLevels], hi_[kMaxLevels];  // where a level begins
  int side_[kMaxLevels];
};

}  // namespace filters
}  // namespace gobo

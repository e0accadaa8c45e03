// SPDX-License-Identifier: Apache-2.0
// Which of the eight samples around one lie on its surface: the raster as a graph, for what walks, labels and spreads over surfaces.
//
// Computes     A bit for each neighbour (kAround), set where both lie on one surface (onOneSurface of filters/stylised/contour.h): a link is one from both
// ends.
//              Samples at the picture's border have no links beyond it.
// Cost         One pass, some 40 ns a sample; a byte each.
#pragma once

#include <cstdint>
#include <vector>

#include "filters/stylised/contour.h"

namespace gobo {
inline namespace filters {

struct RasterStep {
  int x, y;
};
/// Rows go down: clockwise from the right. Even ones share an edge with the middle.
inline constexpr RasterStep kAround[8] = {{1, 0}, {1, 1}, {0, 1}, {-1, 1}, {-1, 0}, {-1, -1}, {0, -1}, {1, -1}};
inline constexpr int kRight = 0, kBelowRight = 1, kBelow = 2, kBelowLeft = 3, kLeft = 4, kAbove = 6;

class SurfaceLinks {
 public:
  /// Of one layer. Errors: Cancelled.
  static Result<SurfaceLinks> of(const ContourInput& in, float cosine, const TaskArena& arena, const StopToken& stop);
  bool has(size_t e, int k) const { return (bits_[e] >> k & 1) != 0; }
  uint8_t bits(size_t e) const { return bits_[e]; }
  size_t neighbour(size_t e, int k) const { return size_t(ptrdiff_t(e) + kAround[k].y * ptrdiff_t(width_) + kAround[k].x); }
  int width() const { return width_; }
  int height() const { return height_; }
  size_t size() const { return bits_.size(); }

 private:
  int width_ = 0, height_ = 0;
  std::vector<uint8_t> bits_;
};

inline constexpr int kMostSweeps = 16;  ///< of sweepLinks; two or three are enough but for spirals

/// Goes over the samples from the top and from the bottom until nothing changes, kMostSweeps times at most: `take(e, f)` lets e have what its linked neighbour
/// f has and says whether it took it. What is nearest so spreads over a surface in two or three rounds, with the error of a vector distance transform
/// (Danielsson 1980): a fraction of a pixel, at few samples. False: stopped.
template <class Take>
bool sweepLinks(const SurfaceLinks& links, const StopToken& stop, const Take& take) {
  const int w = links.width(), h = links.height();
  const auto visit = [&](size_t e, int from, int to) {
    bool took = false;
    for (int k = from; k <= to; ++k)
      if (links.has(e, k & 7)) took |= take(e, links.neighbour(e, k & 7));
    return took;
  };
  bool changed = true;
  for (int round = 0; round < kMostSweeps && changed; ++round) {
    changed = false;
    for (int y = 0; y < h; ++y) {
      if (stop.stopRequested()) return false;
      const size_t row = size_t(y) * size_t(w);
      for (int x = 0; x < w; ++x) changed |= visit(row + size_t(x), 4, 7);       // left and above
      for (int x = w - 1; x >= 0; --x) changed |= visit(row + size_t(x), 8, 8);  // right
    }
    for (int y = h - 1; y >= 0; --y) {
      if (stop.stopRequested()) return false;
      const size_t row = size_t(y) * size_t(w);
      for (int x = w - 1; x >= 0; --x) changed |= visit(row + size_t(x), 0, 3);  // right and below
      for (int x = 0; x < w; ++x) changed |= visit(row + size_t(x), 4, 4);       // left
    }
  }
  return true;
}

}  // namespace filters
}  // namespace gobo

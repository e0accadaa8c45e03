// SPDX-License-Identifier: Apache-2.0
// Loops over the depth map of soft shadows by comparison. What counts as blocking: softBlocks (formulas/soft_shadow.glsl.h).
#pragma once

#include <cstdint>
#include <vector>

#include "base/stop.h"
#include "filters/soft_shadow/soft_receivers.h"

namespace gobo {
inline namespace filters {

/// Weighted by a box: its area, the part of it that blocks, and the sum of the blockers' depths.
struct SoftSums {
  float weight = 0, blocked = 0, depth = 0;
  bool stopped = false;
};

/// What is asked of a kernel: the blocked share and the blockers' depths, or the share alone.
enum class SoftAsk { Blockers, Share };

/// Every texel of a box with its exact weight. `scratch`: at least 2 (side + 8) floats. `z`: level 0 of depth bounds. Looks for a stop after each million
/// texels, a millisecond: whole maps have up to a hundred million.
SoftSums softDense(SoftAsk ask, const float* z, int side, const SoftBlock& b, int i, const SoftBox& box, float* scratch, const StopToken& stop = {});

/// Texels that a box touches: what softDense costs.
inline int softTexels(const SoftBox& box) { return (int(std::ceil(box.x1)) - int(box.x0)) * (int(std::ceil(box.y1)) - int(box.y0)); }

/// What was read of the map for a receiver.
struct SoftWork {
  static constexpr int kChannels = 4;
  float taps = 0, boxes = 0, rows = 0, vectors = 0;  ///< taps; boxes read whole, their rows, eights of texels in them
  void dense(const SoftBox& box) {
    const float high = float(int(std::ceil(box.y1)) - int(box.y0)), wide = float((int(std::ceil(box.x1)) - int(box.x0) + 7) / 8);
    ++boxes;
    rows += high;
    vectors += high * wide;
  }
};

/// Receivers that are read at taps, side by side: loops run over receivers, tap after tap.
struct SoftTaps {
  static constexpr int kSize = SoftBlock::kSize;
  int count = 0;
  int32_t receiver[kSize], base[kSize];              ///< index in the block; first texel of the face
  float x0[kSize], y0[kSize], sx[kSize], sy[kSize];  ///< the box
  float px[kSize], py[kSize], limit[kSize], margin[kSize];
  float a[kSize], ax[kSize], ay[kSize], b[kSize], bx[kSize], by[kSize];
  float near[kSize], range[kSize], metric[kSize], scaleX[kSize], scaleY[kSize];
  float shiftU[kSize], shiftV[kSize];
  float blocked[kSize], depth[kSize], nearest[kSize];  ///< results: share of the taps, sum of depths over the taps, smallest depth among them (or 2)
  void add(const SoftBlock& block, int i, const SoftBox& box, size_t faceTexels, uint64_t element);
};

/// Points of a Fibonacci-like lattice in [0,1)^2: (t + 1/2) / n, t times the golden section. Every receiver reads it shifted by a hash of its own.
struct SoftPattern {
  explicit SoftPattern(int taps);
  int taps;
  std::vector<float> u, v;
  std::vector<float> shrink;  ///< softProbe: width of the box that a tap is drawn from
};
void softTaps(SoftAsk ask, const float* z, int side, const SoftPattern& pattern, SoftTaps& taps);
/// Looks for blockers that lie in the cone to the light at their own depth, in boxes of every width from 1/32 to the whole: thin ones near the receiver are
/// found in however wide a cone. Sets nearest.
void softProbe(const float* z, int side, const SoftPattern& pattern, bool perspective, SoftTaps& taps);

}  // namespace filters
}  // namespace gobo

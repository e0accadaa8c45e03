// SPDX-License-Identifier: Apache-2.0
// BlockerSearch: steps 1 and 2 of soft shadows by comparison (soft_shadow.h) for a block of view samples.
#pragma once

#include "base/stop.h"
#include "filters/soft_shadow/soft_kernels.h"

namespace gobo {
inline namespace filters {

class BlockerSearch {
 public:
  /// `taps` per box; boxes of fewer than kDensePerTap times as many texels are read whole, which costs the same and has no noise. 0: every box.
  explicit BlockerSearch(int taps) : pattern_(taps) {}
  static constexpr int kDensePerTap = 6;
  static constexpr int kPolled = 1 << 14;  // texels: before a box of as many a stop is looked out for; of smaller ones a block's are few

  struct Work {
    explicit Work(int side) : scratch(2 * (size_t(side) + 8)) {}
    SoftBlock b;
    SoftTaps taps;
    SoftSearch search[SoftBlock::kSize];
    std::vector<float> scratch;
    float blocked[SoftBlock::kSize], depth[SoftBlock::kSize];  ///< share of a box, mean over it of the blockers' depths
    int open[SoftBlock::kSize];                                ///< receivers that remain
    float wx[SoftBlock::kSize], wy[SoftBlock::kSize];          ///< their penumbra's widths
    int count = 0;
    SoftWork done[SoftBlock::kSize];  ///< by all since run()
  };
  /// Fills the block; sets V where it is known; for the rest (w.open) the widths of the penumbra's kernel. `first`: element of the block's first receiver.
  /// False: stopped (as it cannot be with `taps`).
  bool run(const SoftReceivers& receivers, const DepthBounds& bounds, size_t first, int count, bool skip, float* V, Work& w, const StopToken& stop = {}) const;

 private:
  SoftPattern pattern_;
};

/// Blocked share (and depths) of box(i) for the open receivers of the block that begins with element `first`. False: stopped.
template <typename BoxOf>
bool softSums(SoftAsk ask, const SoftReceivers& receivers, const DepthBounds& bounds, const SoftPattern& pattern, size_t first, BlockerSearch::Work& w,
              const StopToken& stop, const BoxOf& boxOf) {
  const int side = bounds.resolution();
  w.taps.count = 0;
  for (int k = 0; k < w.count; ++k) {
    const int i = w.open[k];
    const SoftBox box = boxOf(i);
    if (pattern.taps == 0 || softTexels(box) <= BlockerSearch::kDensePerTap * pattern.taps) {
      if (softTexels(box) >= BlockerSearch::kPolled && stop.stopRequested()) return false;
      w.done[i].dense(box);
      const SoftSums s = softDense(ask, bounds.depth(w.b.at.face[i]), side, w.b, i, box, w.scratch.data(), stop);
      if (s.stopped) return false;
      w.blocked[i] = s.blocked / s.weight;
      w.depth[i] = s.depth / s.weight;
    } else {
      w.done[i].taps += float(pattern.taps);
      w.taps.add(w.b, i, box, bounds.faceTexels(), receivers.filmElement(first + size_t(i)));
    }
  }
  if (w.taps.count) softTaps(ask, bounds.depth(0), side, pattern, w.taps);
  for (int k = 0; k < w.taps.count; ++k) {
    w.blocked[w.taps.receiver[k]] = w.taps.blocked[k];
    w.depth[w.taps.receiver[k]] = w.taps.depth[k];
  }
  return true;
}

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// The sink of pictures: sums by group and split.
#pragma once

#include <algorithm>
#include <span>
#include <vector>

#include "trace/path_sink.h"
#include "trace/sample_set.h"

namespace gobo {
inline namespace trace {

/// Adds to out[slot * 3 + channel] of the lanes' pixels. A sum per sample, so that a dropped one is left out whole; pictures with several slots keep a
/// list instead of lanes x slots sums.
class SumSink {
 public:
  static constexpr bool kVertices = false, kLobes = false;
  /// All lanes are of one pixel.
  SumSink(SplitMode split, int slots, double* out) : SumSink(split, slots, std::span(&out, 1)) {}
  /// Lanes of several pixels in turn, as many of each; `out` null: nobody wants them.
  SumSink(SplitMode split, int slots, std::span<double* const> out)
      : split_(split), single_(slots == 1), pixels_(int(out.size())), each_(kLanes / int(out.size())), records_(recordBuffer()) {
    std::copy(out.begin(), out.end(), out_);
  }

  void start(uint64_t, int) {
    for (DVec3& s : sum_) s = DVec3(0.0);
    records_.clear();
  }
  void contribute(int lane, const PathContribution& c) {
    forEachSlot(split_, c, [&](int slot, const Vec3& value) {
      if (single_) sum_[lane] += DVec3(value);
      else records_.push_back({value, lane, slot});
    });
  }
  void finish(uint32_t dropped) {
    if (single_) {
      for (int p = 0; p < pixels_; ++p) {
        double* const o = out_[p];
        if (!o) continue;
        DVec3 total(0.0);
        for (int i = p * each_; i < (p + 1) * each_; ++i)
          if (!(dropped >> i & 1u)) total += sum_[i];
        o[0] += total.x;
        o[1] += total.y;
        o[2] += total.z;
      }
      return;
    }
    for (const Record& r : records_) {
      double* o = out_[r.lane / each_];
      if (!o || (dropped >> r.lane & 1u)) continue;
      o += 3 * r.slot;
      o[0] += r.value.x;
      o[1] += r.value.y;
      o[2] += r.value.z;
    }
  }

 private:
  struct Record {
    Vec3 value;
    int lane, slot;
  };
  static std::vector<Record>& recordBuffer() {  // one a thread: a chunk must not allocate
    static thread_local std::vector<Record> buffer;
    return buffer;
  }
  DVec3 sum_[kLanes];
  SplitMode split_;
  bool single_;
  int pixels_, each_;
  double* out_[kLanes];
  std::vector<Record>& records_;
};

}  // namespace trace
}  // namespace gobo

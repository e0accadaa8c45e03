// SPDX-License-Identifier: Apache-2.0
// The sink of pictures: sums by group and split.
#pragma once

#include <vector>

#include "trace/path_sink.h"
#include "trace/sample_set.h"

namespace gobo {

/// Adds to out[slot * 3 + channel]. A sum per sample, so that a dropped one is left out whole; pictures with several slots keep a list
/// instead of lanes x slots sums.
class SumSink {
 public:
  static constexpr bool kVertices = false, kLobes = false;
  SumSink(SplitMode split, int slots, double* out) : split_(split), single_(slots == 1), out_(out), records_(recordBuffer()) {}

  void start(uint64_t, int count) {
    count_ = count;
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
      DVec3 total(0.0);
      for (int i = 0; i < count_; ++i)
        if (!(dropped >> i & 1u)) total += sum_[i];
      out_[0] += total.x;
      out_[1] += total.y;
      out_[2] += total.z;
      return;
    }
    for (const Record& r : records_) {
      if (dropped >> r.lane & 1u) continue;
      double* o = out_ + 3 * r.slot;
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
  int count_ = 0;
  double* out_;
  std::vector<Record>& records_;
};

}  // namespace gobo

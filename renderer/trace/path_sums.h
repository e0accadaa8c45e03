// SPDX-License-Identifier: Apache-2.0
// Where the contributions of a chunk of paths go.
#pragma once

#include <cmath>
#include <vector>

#include "trace/sample_set.h"

namespace gobo {

// Where contributions go: a sum per sample, so that a sample with a non-finite part can be dropped whole. Pictures with
// several slots keep a list instead of lanes x slots sums.
struct Accumulator {
  struct Record {
    Vec3 value;
    int lane, slot;
  };
  DVec3 sum[kLanes];
  uint32_t bad = 0;  // bit per lane
  bool single;
  std::vector<Record>& records;
  Accumulator(bool single, std::vector<Record>& records) : single(single), records(records) {
    for (DVec3& s : sum) s = DVec3(0.0);
    records.clear();
  }
  void add(int lane, int slot, const Vec3& v) {
    if (!isFinite(v)) {
      bad |= 1u << lane;
      return;
    }  // each channel by itself: the sum of three finite ones may overflow
    if (single) sum[lane] += DVec3(v);
    else records.push_back({v, lane, slot});
  }
  void flush(int count, double* out, uint64_t& dropped) const {
    if (single) {
      DVec3 total(0.0);
      for (int i = 0; i < count; ++i)
        if (!(bad >> i & 1u)) total += sum[i];
      out[0] += total.x;
      out[1] += total.y;
      out[2] += total.z;
    } else {
      for (const Record& r : records) {
        if (bad >> r.lane & 1u) continue;
        double* o = out + 3 * r.slot;
        o[0] += r.value.x;
        o[1] += r.value.y;
        o[2] += r.value.z;
      }
    }
    dropped += uint64_t(__builtin_popcount(bad));
  }
};

inline std::vector<Accumulator::Record>& recordBuffer() {
  static thread_local std::vector<Accumulator::Record> buffer;
  return buffer;
}

}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Summed-area tables of filtered maps (Crow 1984) in integers. Values in [-1, 1] are kept as whole multiples of 1/32767, so that sums are
// exact. The table holds them modulo 2^32; every 8th row and column also has its sum in steps of 2^16, from which any other is at most
// 4 (side + side) texels away: less than 2^31 for sides up to 8192, so that every sum is recovered whole (in 64 bits) and a box of any
// size is exact but for the rounding of its texels. Error of a mean: at most 2^-16. Bytes: 4 C (1 + 1/64) a texel.
#pragma once

#include "base/vec.h"
#include "filters/shadow_map/shadow_map.h"
#include "terms/term.h"

namespace gobo {
inline namespace filters {

class SummedArea {
 public:
  /// A view of a term "shadow_summed_area"; it must outlive this.
  SummedArea(const Term& term, int resolution);
  static Extent extent(int resolution, int faces);
  int channels() const { return channels_; }
  /// out[k]: mean over the box of width x height texels around (x, y) (texel centres at whole numbers) of texels as piecewise constant
  /// areas; the part outside the map is left out, at least one texel is taken.
  void box(int face, float x, float y, float width, float height, float* out) const { box(face, x, y, width, height, 0, channels_, out); }
  /// The same for channels [begin, end) alone.
  void box(int face, float x, float y, float width, float height, int begin, int end, float* out) const;

 private:
  const uint32_t* sums_ = nullptr;  ///< of texels [0, x] x [0, y], modulo 2^32
  const uint32_t* lift_ = nullptr;  ///< of texels [0, 8 i) x [0, 8 j) (the last one: the side), i and j from 1: nearest multiple of 2^16, as int32
  size_t face_ = 0;                 ///< values from one face to the next
  int channels_ = 0, resolution_ = 0;
};

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Summed-area tables of filtered maps (Crow 1984) in integers. Values in [-1, 1] are kept as whole multiples of 2^-15, so that sums are
// exact and wrap around harmlessly: a box is right while its own sum fits. 32-bit sums hold boxes of 248 x 248 texels; larger boxes
// read a table of means over 16 x 16 texels, whose steps are coarse enough for the whole map. Error of a mean: at most 2^-16 (2^-14 beyond).
// Bytes: 4 C (1 + 1/256) a texel.
#pragma once

#include "base/vec.h"
#include "filters/shadow_map/shadow_map.h"
#include "terms/term.h"

namespace gobo {

class SummedArea {
 public:
  /// A view of a term "shadow_summed_area"; it must outlive this.
  SummedArea(const Term& term, int resolution);
  int channels() const { return channels_; }
  /// out[k]: mean over the box of width x height texels around (x, y) (texel centres at whole numbers) of texels as piecewise constant
  /// areas; the part outside the map is left out, at least one texel is taken.
  void box(int face, float x, float y, float width, float height, float* out) const { box(face, x, y, width, height, 0, channels_, out); }
  /// The same for channels [begin, end) alone.
  void box(int face, float x, float y, float width, float height, int begin, int end, float* out) const;

 private:
  struct Table { const uint32_t* sums = nullptr; size_t faceSums = 0; int side = 0; double unit = 1; };
  void corners(const Table& t, int face, float x0, float y0, float x1, float y1, int begin, int end, float* out) const;
  Table fine_, coarse_;
  int channels_ = 0, resolution_ = 0;
};

}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// MipChain: boxes of a given width out of a packed chain of float images ("shadow_basis"), approximately: trilinear, several side by side where
// the box is not square.
#pragma once

#include <span>

#include "filters/shadow_map/shadow_map.h"
#include "terms/term.h"

namespace gobo {
inline namespace filters {

class MipChain {
 public:
  MipChain(const Term& term, int resolution);  ///< a view; the term must outlive it
  int channels() const { return channels_; }
  /// out[k * stride], k < count: about the mean over width x height texels around (x, y), texel centres at whole numbers. count <= 129.
  void box(int face, float x, float y, float width, float height, int count, float* out, size_t stride) const;

 private:
  void add(int face, float x, float y, float level, float weight, int count, float* sum) const;
  const float* texels_;
  size_t faceTexels_;
  int channels_, resolution_, levels_;
  size_t offset_[15];
  int side_[15];
};

}  // namespace filters
}  // namespace gobo

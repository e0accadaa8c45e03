// SPDX-License-Identifier: Apache-2.0
// ShadowTexture: a "shadow_basis" term as lookups read it: f32 or u8 texels of C interleaved values, one level or a packed chain.
// Positions are in texels of level 0 with centres at whole numbers; what lies outside repeats the rim. A view: the term must outlive
// it. Any thread may read.
#pragma once

#include "base/vec.h"
#include "filters/shadow_map/receivers.h"
#include "terms/term.h"

namespace gobo {
inline namespace filters {

class ShadowTexture {
 public:
  ShadowTexture(const Term& term, int resolution, float logarithmic = 0.0f);
  int channels() const { return channels_; }
  int resolution() const { return resolution_; }
  int levels() const { return levels_; }

  /// out[k * stride + i] = channel k of the bilinear mean at receiver i of the block.
  void bilinear(const ReceiverBlock& b, int count, float* out, size_t stride) const;
  /// out[k], at one position of one level (given in texels of level 0).
  void bilinear(int face, float x, float y, int level, float* out) const;
  /// Between the two levels around `level` (0 = finest; limited to the chain).
  void trilinear(int face, float x, float y, float level, float* out) const;
  /// Mean over at most `taps` trilinear lookups along the major axis of a footprint (axes in texels of level 0).
  void anisotropic(int face, float x, float y, const Vec2& major, const Vec2& minor, int taps, float* out) const;

 private:
  const float* floats_ = nullptr;
  const uint8_t* bytes_ = nullptr;
  size_t faceTexels_ = 0;
  MipLevel level_[16];
  int channels_ = 0, resolution_ = 0, levels_ = 1;
  float logarithmic_ = 0.0f;
};

}  // namespace filters
}  // namespace gobo

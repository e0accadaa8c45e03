// SPDX-License-Identifier: Apache-2.0
// SoftReceivers: view samples as soft lookups see them: place in the map, the plane they lie on, how wide the light is from there.
#pragma once

#include "filters/shadow_map/depth_bounds.h"
#include "filters/shadow_map/receivers.h"
#include "filters/soft_shadow/soft_shadow.h"
#include "formulas/soft_shadow.glsl.h"

namespace gobo {
inline namespace filters {

/// A box on one map face in texel edges (texel i is [i, i + 1]), inside [0, resolution].
struct SoftBox {
  float x0, x1, y0, y1;
  float area() const { return (x1 - x0) * (y1 - y0); }
};

struct SoftBlock {
  static constexpr int kSize = ReceiverBlock::kSize;
  ReceiverBlock at;                      ///< x, y, d, face, slopes
  float limit[kSize];                    ///< d less the bias: what lies at or behind it blocks nothing
  float metric[kSize];                   ///< planar depth, metres
  float scaleX[kSize], scaleY[kSize];    ///< texels per unit of softWidth(metric, z, 1)
  float a[kSize], ax[kSize], ay[kSize];  ///< softHeight
  float b[kSize], bx[kSize], by[kSize];
  float margin[kSize];              ///< height from which texels count as above the plane
  float near[kSize], range[kSize];  ///< metric depth of linear depth z: near + z range
  bool perspective;
  float above[kSize];  ///< share of the light above the receiver's plane
  int active[kSize];   ///< receivers whose V is not known from their position alone
  int activeCount;
};

class SoftReceivers {
 public:
  SoftReceivers(const Term& gbuffer, const SoftLookup& lookup, bool slopes);
  /// What it needs of a node's input.
  static void reads(Wiring& wiring, size_t input);
  size_t size() const { return receivers_.size(); }
  /// Fills block and, for receivers that it already decides, V.
  void fill(size_t begin, int count, SoftBlock& block, float* V) const;

  bool perspective() const { return perspective_; }
  float resolution() const { return resolution_; }
  /// What is drawn by chance for a receiver is drawn by this.
  size_t filmElement(size_t element) const { return film_(element); }
  float metric(int face, float z) const { return receivers_.metric(face, z); }
  /// Widths in texels, at least one, of the kernel of receiver i cut at metric depth z.
  void width(const SoftBlock& b, int i, float z, float& wx, float& wy) const {
    const float w = formulas::softWidth(b.metric[i], z, 1.0f, perspective_);
    wx = formulas::limit(w * b.scaleX[i], 1.0f, 2.0f * resolution_);  // twice the map covers it from wherever the receiver is
    wy = formulas::limit(w * b.scaleY[i], 1.0f, 2.0f * resolution_);
  }
  SoftBox box(const SoftBlock& b, int i, float wx, float wy) const {
    const float x = b.at.x[i] + 0.5f, y = b.at.y[i] + 0.5f;
    return {std::max(x - 0.5f * wx, 0.0f), std::min(x + 0.5f * wx, resolution_), std::max(y - 0.5f * wy, 0.0f), std::min(y + 0.5f * wy, resolution_)};
  }

 private:
  void planes(size_t begin, int count, SoftBlock& block, float* V) const;
  Receivers receivers_;
  std::span<const float> P_, N_, Ng_;
  LightFrames frames_;
  SoftLight light_;
  float resolution_, bias_;
  bool perspective_;
  FilmElements film_;
};

/// Where anything could come between receiver i and the light.
struct SoftSearch {
  enum Verdict { Mixed, Lit, Dark } verdict = Mixed;
  float wx = 1, wy = 1;  ///< widths, texels
  SoftBox box;
  float lo = 0, hi = 1;  ///< bounds of the depths in it, or wider
  float plane = 0;       ///< metric depth at which the cone was cut
};
/// Cuts the cone at the smallest depth found in it, again and again (digest 7.4: start at z-min), and asks the bounds, for all active receivers of a
/// block side by side. out[i] for i in b.active.
void softSearches(const SoftReceivers& receivers, const DepthBounds& bounds, const SoftBlock& b, SoftSearch* out);
/// What the bounds say of a box of texels: depths in [lo, hi] all blocking, none blocking, or neither.
SoftSearch::Verdict softVerdict(const SoftBlock& b, int i, const SoftBox& box, float lo, float hi);

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "filters/soft_shadow/mip_chain.h"
#include "formulas/soft_shadow.glsl.h"

namespace gobo {
inline namespace filters {

MipChain::MipChain(const Term& term, int resolution)
    : texels_(term.floats("B").data()), channels_(term.channels("B")), resolution_(resolution), levels_(mipLevels(resolution)) {
  faceTexels_ = size_t(term.extent().width) * size_t(term.extent().height);
  GOBO_CHECK_EQ(faceTexels_, mipTexels(resolution));
  GOBO_CHECK(levels_ <= 15 && channels_ <= 129);
  for (int l = 0; l < levels_; ++l) {
    const MipLevel m = mipLevel(resolution, l);
    offset_[l] = m.offset;
    side_[l] = m.side;
  }
}

void MipChain::add(int face, float x, float y, float level, float weight, int count, float* __restrict sum) const {
  const int low = std::min(int(level), levels_ - 1);
  const float f = level - float(low);
  for (int l = low; l <= std::min(low + 1, levels_ - 1); ++l) {
    const float share = weight * (low == levels_ - 1 ? 1.0f : l == low ? 1.0f - f : f);
    if (share == 0.0f) continue;
    const int side = side_[l];
    const float scale = float(side) / float(resolution_), last = float(side - 1);
    const float u = formulas::limit((x + 0.5f) * scale - 0.5f, 0.0f, last), v = formulas::limit((y + 0.5f) * scale - 0.5f, 0.0f, last);
    const int ix = int(u), iy = int(v);
    const float fx = u - float(ix), fy = v - float(iy);
    const size_t c = size_t(channels_), right = ix + 1 < side ? c : 0, below = iy + 1 < side ? size_t(side) * c : 0;
    const float* __restrict e = texels_ + (size_t(face) * faceTexels_ + offset_[l] + size_t(iy) * size_t(side) + size_t(ix)) * c;
    const float w00 = share * (1 - fx) * (1 - fy), w10 = share * fx * (1 - fy), w01 = share * (1 - fx) * fy, w11 = share * fx * fy;
    for (size_t k = 0; k < size_t(count); ++k) sum[k] += w00 * e[k] + w10 * e[k + right] + w01 * e[k + below] + w11 * e[k + below + right];
  }
}

void MipChain::box(int face, float x, float y, float width, float height, int count, float* __restrict out, size_t stride) const {
  constexpr int kMost = 8;  // lookups side by side: rectangles up to 1 : 8 keep their shape
  float sum[129] = {};
  const float last = float(resolution_);
  // The part inside the map, as a box of its own.
  const auto clip = [last](float& c, float& size) {
    const float lo = std::max(c + 0.5f - 0.5f * size, 0.0f), hi = std::min(c + 0.5f + 0.5f * size, last);
    c = 0.5f * (lo + hi) - 0.5f;
    size = std::max(hi - lo, 1.0f);
  };
  clip(x, width);
  clip(y, height);
  const bool wide = width >= height;
  const float major = wide ? width : height, minor = wide ? height : width;
  const int n = std::clamp(int(major / minor + 0.5f), 1, kMost);
  const float level = formulas::softLevel(std::sqrt(minor * (major / float(n))));
  for (int i = 0; i < n; ++i) {
    const float t = ((float(i) + 0.5f) / float(n) - 0.5f) * major;
    add(face, wide ? x + t : x, wide ? y : y + t, level, 1.0f / float(n), count, sum);
  }
  for (int k = 0; k < count; ++k) out[size_t(k) * stride] = sum[k];
}

}  // namespace filters
}  // namespace gobo

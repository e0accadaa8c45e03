// SPDX-License-Identifier: Apache-2.0
#include "filters/shadow_map/shadow_texture.h"

#include <algorithm>

#include "formulas/convolution_shadow_map.glsl.h"
#include "formulas/shadow_map.glsl.h"

namespace gobo {
inline namespace filters {

using namespace formulas;

ShadowTexture::ShadowTexture(const Term& term, int resolution, float logarithmic) : resolution_(resolution), logarithmic_(logarithmic) {
  channels_ = term.channels("B");
  faceTexels_ = size_t(term.extent().width) * size_t(term.extent().height);
  const size_t square = size_t(resolution) * size_t(resolution);
  GOBO_CHECK(faceTexels_ == square || faceTexels_ == mipTexels(resolution));
  levels_ = faceTexels_ == square ? 1 : mipLevels(resolution);
  GOBO_CHECK(levels_ <= int(std::size(level_)));
  for (int l = 0; l < levels_; ++l) level_[l] = mipLevel(resolution, l);
  for (const Plane& p : term.planes())
    if (p.name == "B") {
      if (p.format == Format::U8) bytes_ = p.bytes.data();
      else floats_ = term.floats("B").data();
    }
}

namespace {

struct Corners {
  size_t at;
  size_t right, below;
  float fx, fy;
};

inline Corners corners(float x, float y, int side) {
  const int ix = std::min(int(x), side - 1), iy = std::min(int(y), side - 1);
  return {size_t(iy) * size_t(side) + size_t(ix), size_t(ix + 1 < side), iy + 1 < side ? size_t(side) : 0, x - float(ix), y - float(iy)};
}

// ln of the bilinear mean of e^{c z}, about the largest of the four: nothing overflows for any c.
inline float logarithmicMean(float z00, float z10, float z01, float z11, float fx, float fy, float c) {
  const float top = formulas::maxOf(formulas::maxOf(z00, z10), formulas::maxOf(z01, z11));
  const float sum = shadowBilinear(fastExp(c * (z00 - top)), fastExp(c * (z10 - top)), fastExp(c * (z01 - top)), fastExp(c * (z11 - top)), fx, fy);
  return top + fastLog(formulas::maxOf(sum, 1e-37f)) / c;
}

template <int C, typename T>
void gather(const T* __restrict texels, size_t faceTexels, int side, const ReceiverBlock& b, int count, float* __restrict out, size_t stride, int channels) {
  const int n = C ? C : channels;
  for (int i = 0; i < count; ++i) {
    const Corners c = corners(b.x[i], b.y[i], side);
    const T* e00 = texels + (size_t(b.face[i]) * faceTexels + c.at) * size_t(n);
    const T* e10 = e00 + c.right * size_t(n);
    const T* e01 = e00 + c.below * size_t(n);
    const T* e11 = e01 + c.right * size_t(n);
    float sum[C ? C : 2 * 32];
    for (int k = 0; k < n; ++k) sum[k] = shadowBilinear(float(e00[k]), float(e10[k]), float(e01[k]), float(e11[k]), c.fx, c.fy);
    for (int k = 0; k < n; ++k) out[size_t(k) * stride + size_t(i)] = sizeof(T) == 1 ? csmFromByte(sum[k]) : sum[k];
  }
}

template <typename T>
void gatherAny(const T* texels, size_t faceTexels, int side, const ReceiverBlock& b, int count, float* out, size_t stride, int channels) {
  switch (channels) {
    case 1: return gather<1>(texels, faceTexels, side, b, count, out, stride, channels);
    case 2: return gather<2>(texels, faceTexels, side, b, count, out, stride, channels);
    case 4: return gather<4>(texels, faceTexels, side, b, count, out, stride, channels);
    case 8: return gather<8>(texels, faceTexels, side, b, count, out, stride, channels);
    case 16: return gather<16>(texels, faceTexels, side, b, count, out, stride, channels);
    case 32: return gather<32>(texels, faceTexels, side, b, count, out, stride, channels);
    default: return gather<0>(texels, faceTexels, side, b, count, out, stride, channels);
  }
}

}  // namespace

void ShadowTexture::bilinear(const ReceiverBlock& b, int count, float* out, size_t stride) const {
  if (logarithmic_ > 0.0f) {
    for (int i = 0; i < count; ++i) {
      const Corners c = corners(b.x[i], b.y[i], resolution_);
      const float* e = floats_ + size_t(b.face[i]) * faceTexels_ + c.at;
      out[i] = logarithmicMean(e[0], e[c.right], e[c.below], e[c.below + c.right], c.fx, c.fy, logarithmic_);
    }
  } else if (bytes_) {
    gatherAny(bytes_, faceTexels_, resolution_, b, count, out, stride, channels_);
  } else {
    gatherAny(floats_, faceTexels_, resolution_, b, count, out, stride, channels_);
  }
}

void ShadowTexture::bilinear(int face, float x, float y, int level, float* __restrict out) const {
  const MipLevel m = level_[level];
  const float scale = float(m.side) / float(resolution_);
  const float last = float(m.side - 1);
  const Corners c = corners(limit((x + 0.5f) * scale - 0.5f, 0.0f, last), limit((y + 0.5f) * scale - 0.5f, 0.0f, last), m.side);
  const size_t n = size_t(channels_), at = (size_t(face) * faceTexels_ + m.offset + c.at) * n;
  if (bytes_) {
    const uint8_t* e = bytes_ + at;
    for (size_t k = 0; k < n; ++k)
      out[k] = csmFromByte(shadowBilinear(e[k], e[k + c.right * n], e[k + c.below * n], e[k + (c.below + c.right) * n], c.fx, c.fy));
  } else if (logarithmic_ > 0.0f) {
    const float* e = floats_ + at;
    out[0] = logarithmicMean(e[0], e[c.right], e[c.below], e[c.below + c.right], c.fx, c.fy, logarithmic_);
  } else {
    const float* e = floats_ + at;
    for (size_t k = 0; k < n; ++k) out[k] = shadowBilinear(e[k], e[k + c.right * n], e[k + c.below * n], e[k + (c.below + c.right) * n], c.fx, c.fy);
  }
}

void ShadowTexture::trilinear(int face, float x, float y, float level, float* __restrict out) const {
  const float l = limit(level, 0.0f, float(levels_ - 1));
  const int low = int(l);
  const float f = l - float(low);
  bilinear(face, x, y, low, out);
  if (f == 0.0f || low + 1 >= levels_) return;
  float coarse[2 * 32 * 2 + 1];
  bilinear(face, x, y, low + 1, coarse);
  if (logarithmic_ > 0.0f) out[0] = logarithmicMean(out[0], coarse[0], out[0], coarse[0], f, 0.0f, logarithmic_);
  else
    for (int k = 0; k < channels_; ++k) out[k] = out[k] * (1.0f - f) + coarse[k] * f;
}

void ShadowTexture::anisotropic(int face, float x, float y, const Vec2& major, const Vec2& minor, int taps, float* __restrict out) const {
  const float a = std::max(glm::length(major), glm::length(minor)), s = std::min(glm::length(major), glm::length(minor));
  const Vec2 axis = glm::length(major) >= glm::length(minor) ? major : minor;
  const int n = std::clamp(int(std::ceil(a / std::max(s, 1.0f))), 1, taps);  // footprints below a texel are one texel wide
  const float level = std::log2(std::max(std::max(s, a / float(n)), 1.0f));
  if (n == 1) return trilinear(face, x, y, level, out);
  float tap[2 * 32 * 2 + 1];
  const float last = float(resolution_ - 1);
  const int count = logarithmic_ > 0.0f ? 1 : channels_;
  float sum[2 * 32 * 2 + 1] = {}, top = 0.0f;
  for (int i = 0; i < n; ++i) {
    const float t = (float(i) + 0.5f) / float(n) - 0.5f;
    trilinear(face, limit(x + t * axis.x, 0.0f, last), limit(y + t * axis.y, 0.0f, last), level, tap);
    if (logarithmic_ > 0.0f) {  // running ln of a sum
      const float high = i ? formulas::maxOf(top, tap[0]) : tap[0];
      sum[0] = (i ? sum[0] * fastExp(logarithmic_ * (top - high)) : 0.0f) + fastExp(logarithmic_ * (tap[0] - high));
      top = high;
    } else {
      for (int k = 0; k < count; ++k) sum[k] += tap[k];
    }
  }
  if (logarithmic_ > 0.0f) out[0] = top + fastLog(sum[0] / float(n)) / logarithmic_;
  else
    for (int k = 0; k < count; ++k) out[k] = sum[k] / float(n);
}

}  // namespace filters
}  // namespace gobo

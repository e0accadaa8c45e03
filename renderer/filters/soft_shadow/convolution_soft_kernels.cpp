// SPDX-License-Identifier: Apache-2.0
#include "filters/soft_shadow/convolution_soft_kernels.h"

#include <algorithm>

#include "formulas/convolution_shadow_map.glsl.h"
#include "formulas/soft_shadow.glsl.h"

namespace gobo {
inline namespace filters {

using namespace formulas;

namespace {
constexpr size_t kRun = 64;
}

void encodeConvolutionSoft(const float* __restrict z, float* __restrict out, size_t n, int order) {
  const size_t images = 2 * size_t(order), channels = 2 * images + 1;
  float basis[kRun * 2 * kMaxConvolutionOrder];
  for (size_t first = 0; first < n; first += kRun) {
    const size_t m = std::min(kRun, n - first);
    encodeConvolution(z + first, basis, m, order);
    for (size_t i = 0; i < m; ++i) {
      float* to = out + (first + i) * channels;
      const float* from = basis + i * images;
      const float depth = shadowDepth(z[first + i]);
      for (size_t k = 0; k < images; ++k) {
        to[k] = from[k];
        to[images + k] = from[k] * depth;
      }
      to[2 * images] = depth;
    }
  }
}

void convolutionSelf(const float* __restrict x, const float* __restrict y, const float* __restrict d, const float* __restrict shift, float* __restrict self,
                     float* __restrict selfDepth, size_t n, const ConvolutionParameters& p) {
  const float step = csmAngle(1.0f, float(p.order)), base = 1.0f - (p.scaling ? 0.5f * p.scale : 0.5f);
  for (size_t i = 0; i < n; ++i) {
    self[i] = base;
    selfDepth[i] = 0.0f;
  }
  for (int k = 0; k < p.order; ++k) {
    const float w = p.scale * csmWeight(float(k + 1), float(p.order), p.attenuation), c = float(2 * k + 1) * step;
    for (size_t i = 0; i < n; ++i) {
      const float o = c * (p.offset + shift[i]), sx = softSinc(c * x[i]), sy = softSinc(c * y[i]);
      self[i] -= w * fastSin(o) * (sx * sy);
      selfDepth[i] += w * fastCos(o) * (x[i] * softSincSlope(c * x[i]) * sy + y[i] * softSincSlope(c * y[i]) * sx);
    }
  }
  for (size_t i = 0; i < n; ++i) selfDepth[i] += (d[i] + shift[i]) * self[i];
}

void convolutionFull(const float* __restrict z, const float* __restrict d, float* __restrict full, size_t n, const ConvolutionParameters& p) {
  const float step = csmAngle(1.0f, float(p.order)), base = 1.0f - (p.scaling ? 0.5f * p.scale : 0.5f);
  for (size_t i = 0; i < n; ++i) full[i] = base;
  for (int k = 0; k < p.order; ++k) {
    const float w = p.scale * csmWeight(float(k + 1), float(p.order), p.attenuation), c = float(2 * k + 1) * step;
    for (size_t i = 0; i < n; ++i) full[i] -= w * fastSin(c * (z[i] - d[i] + p.offset));
  }
}

void convolutionBlockers(const float* __restrict values, size_t stride, const float* __restrict d, const float* __restrict self,
                         const float* __restrict selfDepth, float* __restrict blocked, float* __restrict depth, size_t n, const ConvolutionParameters& p) {
  const size_t images = 2 * size_t(p.order);
  convolutionSeries(values, stride, d, blocked, n, p);
  convolutionSeries(values + images * stride, stride, d, depth, n, p);
  const float* mean = values + 2 * images * stride;
  const float base = 1.0f - (p.scaling ? 0.5f * p.scale : 0.5f);
  for (size_t i = 0; i < n; ++i) {
    const float share = softUnmix(base - p.scale * blocked[i], self[i], 1.0f);
    const float rest = limit(1.0f - share, 0.0f, 1.0f);
    depth[i] = base * mean[i] - p.scale * depth[i] - rest * selfDepth[i];
    blocked[i] = share;
  }
}

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "filters/exponential_shadow_map/exponential_shadow_map_kernels.h"

#include <algorithm>

#include "formulas/exponential_shadow_map.glsl.h"

namespace gobo {

using namespace formulas;

std::vector<float> exponentialShadowWeights(int radius) {
  std::vector<float> weights(size_t(2 * radius + 1));
  const float sigma = float(2 * radius + 1) / 4.0f;
  double sum = 0.0;
  for (int k = -radius; k <= radius; ++k) sum += weights[k + radius] = esmGaussian(float(k), sigma);
  for (float& w : weights) w = float(w / sum);
  return weights;
}

void encodeExponential(const float* __restrict z, float* __restrict e, size_t n, float c) {
  for (size_t i = 0; i < n; ++i) e[i] = esmEncode(z[i], c);
}

namespace {
constexpr int kBlock = 256;   // values kept in the first-level cache between the loops of a pass
}

void filterRow(const float* __restrict padded, const float* __restrict weights, int taps, float* __restrict out, int n) {
  for (int first = 0; first < n; first += kBlock) {
    const int m = std::min(kBlock, n - first);
    float sum[kBlock];
    for (int x = 0; x < m; ++x) sum[x] = weights[0] * padded[first + x];
    for (int k = 1; k < taps; ++k) {
      const float w = weights[k];
      const float* p = padded + first + k;
      for (int x = 0; x < m; ++x) sum[x] = sum[x] + w * p[x];
    }
    for (int x = 0; x < m; ++x) out[first + x] = sum[x];
  }
}

void filterColumns(const float* const* rows, const float* __restrict weights, int taps, float* __restrict out, int n) {
  for (int first = 0; first < n; first += kBlock) {
    const int m = std::min(kBlock, n - first);
    float sum[kBlock];
    for (int x = 0; x < m; ++x) sum[x] = weights[0] * rows[0][first + x];
    for (int k = 1; k < taps; ++k) {
      const float w = weights[k];
      const float* p = rows[k] + first;
      for (int x = 0; x < m; ++x) sum[x] = sum[x] + w * p[x];
    }
    for (int x = 0; x < m; ++x) out[first + x] = sum[x];
  }
}

ExponentialLookupParameters lookupParameters(const ExponentialShadowLookup& lookup, int width, int height, uint32_t count) {
  const LightFrame::Rows rows = lookup.frame.rows();
  ExponentialLookupParameters p{};
  for (int i = 0; i < 4; ++i) {
    p.u[i] = rows.u[i];
    p.v[i] = rows.v[i];
    p.w[i] = rows.w[i];
    p.d[i] = rows.d[i];
  }
  for (int i = 0; i < 3; ++i) p.origin[i] = lookup.frame.origin[i];
  p.c = lookup.c;
  p.bias = lookup.bias;
  p.width = width;
  p.height = height;
  p.count = count;
  return p;
}

void lookupExponential(const ExponentialLookupParameters& parameters, const float* __restrict map, const float* __restrict positions,
                       const uint32_t* __restrict instances, float* __restrict visibility, size_t count) {
  const ExponentialLookupParameters p = parameters;   // a local copy: no store below can change it
  const float width = float(p.width), height = float(p.height);
  // Three loops over a block: coordinates (vectorised), the four loads (scalar), the mean and the test (vectorised).
  float fx[kBlock], fy[kBlock], receiver[kBlock], e00[kBlock], e10[kBlock], e01[kBlock], e11[kBlock];
  int32_t at[kBlock], stepX[kBlock], stepY[kBlock], covered[kBlock];
  for (size_t first = 0; first < count; first += kBlock) {
    const int m = int(std::min<size_t>(kBlock, count - first));
    const float* P = positions + 3 * first;
    const uint32_t* instance = instances + first;
    float* V = visibility + first;
    for (int i = 0; i < m; ++i) {
      const float x = P[3 * i] - p.origin[0], y = P[3 * i + 1] - p.origin[1], z = P[3 * i + 2] - p.origin[2];
      const float inverseW = esmInverse(esmRow(p.w[0], p.w[1], p.w[2], p.w[3], x, y, z));
      const float u = esmRow(p.u[0], p.u[1], p.u[2], p.u[3], x, y, z) * inverseW;
      const float v = esmRow(p.v[0], p.v[1], p.v[2], p.v[3], x, y, z) * inverseW;
      const float tx = esmTexel(u, width), ty = esmTexel(v, height);
      const int ix = int(tx), iy = int(ty);
      fx[i] = tx - float(ix);
      fy[i] = ty - float(iy);
      at[i] = iy * p.width + ix;
      stepX[i] = CHOOSE(ix + 1 < p.width, 1, 0);
      stepY[i] = CHOOSE(iy + 1 < p.height, p.width, 0);
      receiver[i] = esmReceiver(esmRow(p.d[0], p.d[1], p.d[2], p.d[3], x, y, z), p.c, p.bias);
      covered[i] = CHOOSE(esmCovered(u, v, inverseW) && instance[i] != ~0u, 1, 0);
    }
    for (int i = 0; i < m; ++i) {
      const float* e = map + at[i];
      e00[i] = e[0];
      e10[i] = e[stepX[i]];
      e01[i] = e[stepY[i]];
      e11[i] = e[stepY[i] + stepX[i]];
    }
    for (int i = 0; i < m; ++i)
      V[i] = esmVisibility(esmBilinear(e00[i], e10[i], e01[i], e11[i], fx[i], fy[i]), receiver[i], covered[i] != 0);
  }
}

}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "filters/shadow_map/gaussian_kernels.h"

#include <algorithm>

#include "formulas/convolution_shadow_map.glsl.h"

namespace gobo {
inline namespace filters {

using namespace formulas;

namespace {

constexpr size_t kBlock = 256;  // values kept in the first-level cache between the loops of a pass

template <typename Tap>
void weightedSum(const Tap& tap, const float* __restrict weights, int taps, float* __restrict out, size_t n) {
  for (size_t first = 0; first < n; first += kBlock) {
    const size_t m = std::min(kBlock, n - first);
    float sum[kBlock];
    const float* p = tap(0) + first;
    for (size_t x = 0; x < m; ++x) sum[x] = weights[0] * p[x];
    for (int k = 1; k < taps; ++k) {
      const float w = weights[k];
      p = tap(k) + first;
      for (size_t x = 0; x < m; ++x) sum[x] = sum[x] + w * p[x];
    }
    for (size_t x = 0; x < m; ++x) out[first + x] = sum[x];
  }
}

template <typename Tap>
void weightedLogarithm(const Tap& tap, const float* __restrict weights, int taps, float c, float* __restrict out, size_t n) {
  for (size_t first = 0; first < n; first += kBlock) {
    const size_t m = std::min(kBlock, n - first);
    float top[kBlock], sum[kBlock];
    const float* p = tap(0) + first;
    for (size_t x = 0; x < m; ++x) top[x] = p[x];
    for (int k = 1; k < taps; ++k) {
      p = tap(k) + first;
      for (size_t x = 0; x < m; ++x) top[x] = formulas::maxOf(top[x], p[x]);
    }
    for (size_t x = 0; x < m; ++x) sum[x] = 0.0f;
    for (int k = 0; k < taps; ++k) {
      const float w = weights[k];
      p = tap(k) + first;
      for (size_t x = 0; x < m; ++x) sum[x] += w * fastExp(c * (p[x] - top[x]));
    }
    for (size_t x = 0; x < m; ++x) out[first + x] = top[x] + fastLog(sum[x]) / c;
  }
}

}  // namespace

void filterRow(const float* padded, const float* weights, int taps, size_t step, float* out, size_t n) {
  weightedSum([=](int k) { return padded + size_t(k) * step; }, weights, taps, out, n);
}
void filterColumns(const float* const* rows, const float* weights, int taps, float* out, size_t n) {
  weightedSum([=](int k) { return rows[k]; }, weights, taps, out, n);
}
void filterRowLogarithmic(const float* padded, const float* weights, int taps, float c, float* out, size_t n) {
  weightedLogarithm([=](int k) { return padded + k; }, weights, taps, c, out, n);
}
void filterColumnsLogarithmic(const float* const* rows, const float* weights, int taps, float c, float* out, size_t n) {
  weightedLogarithm([=](int k) { return rows[k]; }, weights, taps, c, out, n);
}
void toBytes(const float* __restrict values, uint8_t* __restrict out, size_t n) {
  for (size_t i = 0; i < n; ++i) out[i] = uint8_t(int(csmToByte(values[i])));  // through int: that conversion has a vector form
}

}  // namespace filters
}  // namespace gobo

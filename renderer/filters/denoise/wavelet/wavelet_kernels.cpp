// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/wavelet/wavelet_kernels.h"

#include <algorithm>
#include <cmath>

#include "filters/denoise/fast_exp.h"

namespace gobo::denoise {

namespace {

constexpr int kWaveletTile = 256;         // pixels of a row whose sums stay in the first cache
constexpr float kLeastExponent = -40.0f;  // weights below 4e-18 are 0: their squares would be slow denormal numbers
constexpr float kSpline[3] = {0.375f, 0.25f, 0.0625f};

/// w[t]: of the pixels p + t + shift for p + t.
void waveletWeights(const WaveletLevel& k, size_t p, ptrdiff_t shift, int n, float kernel, float perDistance, float* __restrict w) {
  const float* __restrict fx = k.facing[0] + p, * __restrict fy = k.facing[1] + p, * __restrict fz = k.facing[2] + p, * __restrict none = k.facing[3] + p;
  const float* __restrict x = k.place[0] + p, * __restrict y = k.place[1] + p, * __restrict z = k.place[2] + p;
  const float* __restrict perPlane = k.perPlane + p, * __restrict perSigma = k.perSigma + p, * __restrict guide = k.in[k.channels - 1] + p;
  const float power = k.power;
  for (int t = 0; t < n; ++t) {
    const ptrdiff_t q = t + shift;
    const float cosine = fx[t] * fx[q] + fy[t] * fy[q] + fz[t] * fz[q] + none[t] * none[q];
    const float along = fx[t] * (x[q] - x[t]) + fy[t] * (y[q] - y[t]) + fz[t] * (z[q] - z[t]);
    const float turned = fastLog(std::min(std::max(cosine, 1e-38f), 1.0f));  // -87 where they do not look the same way
    const float e = power * turned - std::fabs(along) * perPlane[t] * perDistance - std::fabs(guide[q] - guide[t]) * perSigma[t];
    const float weight = kernel * fastExp(e);
    w[t] = e > kLeastExponent ? weight : 0.0f;
  }
}

void addWeighted(const float* __restrict w, const float* __restrict in, int n, float* __restrict sum) {
  for (int t = 0; t < n; ++t) sum[t] += w[t] * in[t];
}
void addWeights(const float* __restrict w, const float* __restrict variance, int n, float* __restrict sum, float* __restrict mean, float* __restrict squares) {
  for (int t = 0; t < n; ++t) {
    const float of = w[t] * variance[t];
    sum[t] += w[t];
    mean[t] += of;
    squares[t] += w[t] * of;
  }
}

}  // namespace

void waveletRow(const WaveletLevel& k, int y) {
  float w[kWaveletTile], weights[kWaveletTile], mean[kWaveletTile], squares[kWaveletTile], sums[7][kWaveletTile];
  for (int x0 = 0; x0 < k.width; x0 += kWaveletTile) {
    const int n = std::min(kWaveletTile, k.width - x0);
    const size_t row = size_t(y) * size_t(k.width) + size_t(x0);
    // The pixel itself first: it always counts, so that no sum is 0.
    const float middle = kSpline[0] * kSpline[0];
    for (int t = 0; t < n; ++t) {
      weights[t] = middle;
      mean[t] = middle * k.variance[row + size_t(t)];
      squares[t] = middle * mean[t];
    }
    for (int c = 0; c < k.channels; ++c)
      for (int t = 0; t < n; ++t) sums[c][t] = middle * k.in[c][row + size_t(t)];
    for (int j = -2; j <= 2; ++j) {
      const int v = y + j * k.spacing;
      if (v < 0 || v >= k.height) continue;
      for (int i = -2; i <= 2; ++i) {
        if (i == 0 && j == 0) continue;
        const int dx = i * k.spacing, begin = std::max(x0, -dx), end = std::min(x0 + n, k.width - dx);
        if (begin >= end) continue;
        const int first = begin - x0, count = end - begin;
        const size_t p = row + size_t(first);
        const ptrdiff_t shift = ptrdiff_t(j) * k.spacing * k.width + dx;
        const float distance = float(k.spacing) * std::sqrt(float(i * i + j * j));
        waveletWeights(k, p, shift, count, kSpline[std::abs(i)] * kSpline[std::abs(j)], 1.0f / distance, w);
        addWeights(w, k.variance + p + shift, count, weights + first, mean + first, squares + first);
        for (int c = 0; c < k.channels; ++c) addWeighted(w, k.in[c] + p + shift, count, sums[c] + first);
      }
    }
    for (int c = 0; c < k.channels; ++c)
      for (int t = 0; t < n; ++t) k.out[c][row + size_t(t)] = sums[c][t] / weights[t];
    for (int t = 0; t < n; ++t) {
      const float apart = squares[t] / (weights[t] * weights[t]), together = mean[t] / weights[t];
      k.varianceOut[row + size_t(t)] = apart + k.correlated * (together - apart);
    }
  }
}

void perSigmaRow(const float* nothing, const float* variance, int width, int height, int y, float scale, float* perSigma) {
  constexpr float kTaps[2] = {0.5f, 0.25f};
  float weights[kWaveletTile], sums[kWaveletTile];
  for (int x0 = 0; x0 < width; x0 += kWaveletTile) {
    const int n = std::min(kWaveletTile, width - x0);
    const size_t row = size_t(y) * size_t(width) + size_t(x0);
    std::fill_n(weights, n, 0.0f);
    std::fill_n(sums, n, 0.0f);
    for (int j = -1; j <= 1; ++j) {
      if (y + j < 0 || y + j >= height) continue;
      for (int i = -1; i <= 1; ++i) {
        const int begin = std::max(x0, -i), end = std::min(x0 + n, width - i), first = begin - x0, count = end - begin;
        const float *p = nothing + row + first, *q = p + ptrdiff_t(j) * width + i, *v = variance + row + first + ptrdiff_t(j) * width + i;
        const float kernel = kTaps[std::abs(i)] * kTaps[std::abs(j)];
        float *sum = sums + first, *weight = weights + first;
        for (int t = 0; t < count; ++t) {
          const float w = p[t] == q[t] ? kernel : 0.0f;
          weight[t] += w;
          sum[t] += w * v[t];
        }
      }
    }
    // Without noise no difference is noise; what is added is only there to divide by.
    for (int t = 0; t < n; ++t) perSigma[row + size_t(t)] = 1.0f / (scale * std::sqrt(sums[t] / weights[t]) + 1e-30f);
  }
}

}  // namespace gobo::denoise

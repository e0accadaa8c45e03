// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/first_order/regression.h"

#include <algorithm>
#include <cmath>

namespace gobo::denoise {

namespace {

constexpr int kRow = 64;  // pixels whose products are made at once

void subtractRow(const float* __restrict a, const float* __restrict b, int n, float* __restrict out) {
  for (int t = 0; t < n; ++t) out[t] = a[t] - b[t];
}
void productRow(const float* __restrict a, const float* __restrict b, int n, float* __restrict out) {
  for (int t = 0; t < n; ++t) out[t] = a[t] * b[t];
}
void addProductRow(const float* __restrict a, const float* __restrict b, int n, float* __restrict sum) {
  for (int t = 0; t < n; ++t) sum[t] += a[t] * b[t];
}
void addPlainRow(const float* __restrict a, int n, float* __restrict sum) {
  for (int t = 0; t < n; ++t) sum[t] += a[t];
}

}  // namespace

void addNeighbours(const float* own, const float* other, size_t featureStride, const float* const* light, const float* w, int n, size_t stride, float* sums) {
  float apart[kRegressors][kRow], weighted[kRegressors][kRow];
  for (int t = 0; t < n; t += kRow) {
    const int m = std::min(kRow, n - t);
    std::copy_n(w + t, m, weighted[0]);
    for (int j = 1; j < kRegressors; ++j) {
      subtractRow(other + size_t(j - 1) * featureStride + t, own + size_t(j - 1) * featureStride + t, m, apart[j]);
      productRow(w + t, apart[j], m, weighted[j]);
    }
    float* sum = sums + t;
    for (int i = 0; i < kRegressors; ++i)
      for (int j = i; j < kRegressors; ++j, sum += stride) {
        if (i == 0) addPlainRow(weighted[j], m, sum);
        else addProductRow(weighted[i], apart[j], m, sum);
      }
    for (int c = 0; c < 3; ++c)
      for (int j = 0; j < kRegressors; ++j, sum += stride) addProductRow(weighted[j], light[c] + t, m, sum);
  }
}

void solveFit(const float* sums, size_t stride, float* fit) {
  double a[kRegressors][kRegressors];
  const auto* product = sums;
  for (int i = 0; i < kRegressors; ++i)
    for (int j = i; j < kRegressors; ++j, product += stride) a[j][i] = double(*product);
  const double ridge = kRidge * a[0][0];
  for (int i = 1; i < kRegressors; ++i) a[i][i] += ridge;
  // Cholesky, in place of the lower triangle. The ridge keeps pivots positive; rounding of huge weights might not.
  for (int i = 0; i < kRegressors; ++i)
    for (int j = 0; j <= i; ++j) {
      double s = a[i][j];
      for (int k = 0; k < j; ++k) s -= a[i][k] * a[j][k];
      a[i][j] = i == j ? std::sqrt(std::max(s, 0.5 * ridge)) : s / a[j][j];
    }
  for (int c = 0; c < 3; ++c) {
    double x[kRegressors] = {};
    for (int i = 0; i < kRegressors; ++i, product += stride) {
      double s = double(*product);
      for (int k = 0; k < i; ++k) s -= a[i][k] * x[k];
      x[i] = s / a[i][i];
    }
    for (int i = kRegressors - 1; i >= 0; --i) {
      for (int k = i + 1; k < kRegressors; ++k) x[i] -= a[k][i] * x[k];
      x[i] /= a[i][i];
    }
    for (int i = 0; i < kRegressors; ++i) fit[c * kRegressors + i] = float(std::clamp(x[i], -1e30, 1e30));
  }
}

namespace {

/// Adds w times the prediction of one channel; mean: of the fit's window.
void addPredictionRow(const float (&apart)[kRegressors][kRow], const float* __restrict fit, size_t fitStride, const float* __restrict mean,
                      const float* __restrict w, int n, float* __restrict sum) {
  for (int t = 0; t < n; ++t) {
    float value = fit[t];
    for (int j = 1; j < kRegressors; ++j) value += apart[j][t] * fit[size_t(j) * fitStride + size_t(t)];
    const float lo = std::min(0.0f, 4.0f * mean[t]), hi = std::max(0.0f, 4.0f * mean[t]);
    sum[t] += w[t] * std::min(std::max(value, lo), hi);
  }
}

}  // namespace

void addPredictions(const float* at, const float* from, size_t featureStride, const float* fit, size_t fitStride, const float* w, int n, size_t stride,
                    float* sum) {
  float apart[kRegressors][kRow];
  for (int t = 0; t < n; t += kRow) {
    const int m = std::min(kRow, n - t);
    for (int j = 1; j < kRegressors; ++j) subtractRow(at + size_t(j - 1) * featureStride + t, from + size_t(j - 1) * featureStride + t, m, apart[j]);
    for (int c = 0; c < 3; ++c)
      addPredictionRow(apart, fit + size_t(c * kRegressors) * fitStride + t, fitStride, fit + size_t(kFit + c) * fitStride + t, w + t, m,
                       sum + size_t(c) * stride + t);
    addPlainRow(w + t, m, sum + 3 * stride + t);
  }
}

}  // namespace gobo::denoise

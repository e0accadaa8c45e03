// SPDX-License-Identifier: Apache-2.0
// Normal equations of many pixels side by side, and their solution.
#pragma once

#include <cstddef>

namespace gobo::denoise {

inline constexpr int kRegressors = 8;                                  ///< constant, albedo, normal, depth
inline constexpr int kProducts = kRegressors * (kRegressors + 1) / 2;  ///< upper triangle, row by row
inline constexpr int kSums = kProducts + 3 * kRegressors;              ///< and those with three channels of light
inline constexpr int kFit = 3 * kRegressors;                           ///< coefficients of a fit: channel by channel
inline constexpr double kRidge = 1e-3;

/// For n pixels: adds to sums[k * stride + t], k < kSums, what one neighbour of each brings. own[j * featureStride + t], other: features of the pixels and the
/// neighbours, j < kRegressors - 1; light[c]: of the neighbours; w: weights.
void addNeighbours(const float* own, const float* other, size_t featureStride, const float* const* light, const float* w, int n, size_t stride, float* sums);

/// Coefficients of the fit from a pixel's sums (`stride` apart), kFit floats.
void solveFit(const float* sums, size_t stride, float* fit);

/// For n pixels q: adds w fit(x_q - x_p) to sum[c * stride + t] and w to sum[3 * stride + t]. fit[k * fitStride + t]: of the pixels p.
void addPredictions(const float* at, const float* from, size_t featureStride, const float* fit, size_t fitStride, const float* w, int n, size_t stride,
                    float* sum);

}  // namespace gobo::denoise

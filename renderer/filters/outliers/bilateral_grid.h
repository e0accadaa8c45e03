// SPDX-License-Identifier: Apache-2.0
// The bilateral filter by a grid (Paris & Durand 2006, "A fast approximation of the bilateral filter using a signal processing approach"; Chen, Paris & Durand
// 2007): pixels are splatted into cells of film and brightness with the number 1 beside their light, cells are blurred, and each pixel takes light over number
// where it lies. RGB, width * height * 3.
#pragma once

#include "filters/outliers/sample_estimators.h"

namespace gobo::outliers {

/// Gaussians of `space` pixels and of `range` in brightness = log(1 + luminance / white): about the luminance over white where it is dark, its logarithm where
/// it is bright; negative luminance counts as 0, and beyond 1e6 white all are alike. Cells are as large.
struct BilateralGrid {
  double space = 2.0;  ///< >= 0.5
  double range = 0.1;  ///< >= 0.01
  double white = 1.0;  ///< > 0
};

/// Where it differs from the exact filter of that brightness it does by less than a fifth of what that changes (RMS, on smooth and on noisy pictures).
/// Each value is a mean of the picture's within 4 cells, so that steps of more than 4 `range` stay as they are, spikes with them; no sum is kept. Pixels that
/// are not finite count for nothing and stay. The same bits for any number of threads; 32 bytes a cell of 16 + 5 rows of cells a thread.
std::vector<float> bilateralGrid(const std::vector<float>& rgb, int width, int height, const BilateralGrid& settings = {}, const Rows& rows = {});

}  // namespace gobo::outliers

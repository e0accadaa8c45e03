// SPDX-License-Identifier: Apache-2.0
// Error metrics between pictures (linear radiance, RGB channels averaged) and against a reference given as two
// independent halves. All sums in float64.
#pragma once

#include <vector>

#include "base/image.h"
#include "base/status.h"

namespace gobo {

struct ErrorFigures {
  double rmse = 0, relMse = 0, meanAbs = 0, p99 = 0, maxAbs = 0, ssim = 0, flip = 0;
  double meanA = 0, meanB = 0;        ///< mean luminance
  size_t differingPixels = 0;         ///< not bitwise equal
  size_t nonFinite = 0;
};
/// Errors: InvalidArgument on different sizes.
Result<ErrorFigures> compareImages(const Image& a, const Image& b);

struct HalvesError {
  double mse = 0, standardError = 0;       ///< mean((A-p)(B-p)), unbiased though the halves are noisy; se over pixels
  double rmse = 0, rmseStandardError = 0;  ///< sqrt(max(mse,0)) and its propagated se
  double relMse = 0, relMseStandardError = 0;  ///< each pixel divided by (A*B mean)^2 + 1e-2
};
/// Squared error of `picture` against the truth of which A and B are independent unbiased estimates.
Result<HalvesError> errorAgainstHalves(const Image& picture, const Image& halfA, const Image& halfB);

/// Signed difference picture, blue below, red above, `scale` = the error shown at full colour.
Image differenceImage(const Image& a, const Image& b, float scale);

}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Error metrics between pictures (linear radiance, RGB channels averaged) and against a reference given as two
// independent halves. All sums in float64. Pure functions; any thread. The first three channels are compared (or the first
// alone, for pictures with fewer than three).
#pragma once

#include <cstdint>
#include <vector>

#include "base/image.h"
#include "base/status.h"

namespace gobo {
inline namespace measure {

struct ErrorFigures {
  double rmse = 0;              ///< sqrt of the mean over pixels and channels of (a - b)^2
  double relMse = 0;            ///< mean over pixels and channels of (a - b)^2 / (b^2 + 1e-2)
  double meanAbs = 0;           ///< mean over pixels and channels of |a - b|
  double p99 = 0;               ///< 99th percentile (nearest rank) over pixels of a pixel's mean |a - b|
  double maxAbs = 0;            ///< largest |a - b| of any channel
  double ssim = 0;              ///< measure/perceptual.h, display-mapped luma
  double flip = 0;              ///< mean LDR-FLIP, measure/perceptual.h, at 67.02 pixels per degree
  double meanA = 0, meanB = 0;  ///< mean luminance
  size_t differingPixels = 0;   ///< not bitwise equal in the compared channels (+0 and -0 differ)
  size_t nonFinite = 0;         ///< pixels with a NaN or Inf in either: left out of all the above but ssim and flip
  size_t nonFiniteApart = 0;    ///< of those, the ones that are not the same in both to the bit
};
/// b is the reference. Errors: InvalidArgument on different or empty sizes.
Result<ErrorFigures> compareImages(const Image& a, const Image& b);
/// The same without SSIM and FLIP (they stay 0), over the pixels whose `mask` is not 0: one byte a pixel, e.g. penumbraMask.
/// An empty selection gives zeros.
Result<ErrorFigures> compareImages(const Image& a, const Image& b, const std::vector<uint8_t>& mask);

/// Pixels whose first channel (a visibility) lies in (low, high) in `truth`, dilated by `dilation` pixels in both directions:
/// where shadow techniques err, undiluted by the lit and the dark.
std::vector<uint8_t> penumbraMask(const Image& truth, float low = 0.02f, float high = 0.98f, int dilation = 2);

struct HalvesError {
  double mse = 0, standardError = 0;           ///< mean((A-p)(B-p)), unbiased though the halves are noisy; se over pixels
  double mseLow = 0, mseHigh = 0;              ///< 95 % interval (measure/confidence.h, meanInterval), at least 0
  double rmse = 0, rmseStandardError = 0;      ///< sqrt(max(mse,0)); its se is sqrt(m + se) - sqrt(m), about se / (2 rmse)
  double relMse = 0, relMseStandardError = 0;  ///< measure/halves.h: leaning; the se includes its distance to the jackknife
  size_t nonFinite = 0;                        ///< pixels with a NaN or Inf in any of the three: left out
};
/// Squared error of `picture` against the truth of which A and B are independent unbiased estimates. The standard errors
/// take pixels' noise as independent. Errors: InvalidArgument on different or empty sizes.
Result<HalvesError> errorAgainstHalves(const Image& picture, const Image& halfA, const Image& halfB);

/// Signed difference of luminance, a - b: white where equal, blue below, red above, `scale` (> 0) = the error shown at full
/// colour. Linear display-referred RGB in 0..1; a non-finite difference is black. The sizes must agree (CHECKed).
Image differenceImage(const Image& a, const Image& b, float scale);

}  // namespace measure
}  // namespace gobo

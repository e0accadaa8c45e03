// SPDX-License-Identifier: Apache-2.0
// Table 5.1 of the thesis of 2007 on hybrid environment light (digest of seed 004, C6 and chapter 5; rows 24 and 27): mean and standard deviation of the
// absolute difference of luminance between a picture and a reference, of the light itself and of what a display shows of it by y = 1 - exp(-c x). Luminances
// are given as numbers, one a pixel, row by row: luminancesOf, or of what no Image holds. Sums in double, in one order, the deviation about the mean itself (no
// difference of large squares). Pure; any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "base/image.h"
#include "base/status.h"

namespace gobo {
inline namespace measure {

/// Rec. 709 luminance by pixel; of pictures of fewer than three channels the first.
std::vector<double> luminancesOf(const Image& image);

/// What a display shows, 0 .. 1, of luminance x at exposure c >= 0: 1 - exp(-c x), without cancellation for small c x. Light below 0 shows as none; NaN stays.
double displayedByExponential(double luminance, double exposure);
/// The c that shows `luminance` (> 0) as a half.
double exposureOfHalf(double luminance);

struct LuminanceDifference {
  double mean = 0, deviation = 0;            ///< of |a - b|; the deviation of the pixels themselves, not of a sample from more
  double shownMean = 0, shownDeviation = 0;  ///< the same of what is displayed
  size_t pixels = 0;                         ///< that were compared
  size_t nonFinite = 0;                      ///< with a NaN or Inf in either: left out of all the above
};
/// Of pixels whose `mask` is not 0, one byte a pixel; an empty mask is all of them. No pixel that can be compared: zeros. Errors: InvalidArgument where sizes
/// differ or are 0, and for an exposure that is not finite or below 0.
Result<LuminanceDifference> luminanceDifference(std::span<const double> picture, std::span<const double> reference, double exposure,
                                                std::span<const uint8_t> mask = {});

/// Pixels near a shadow's edge: where the reference's luminances within `reach` pixels to both sides (a square) spread over more than `share` of the largest of
/// them. 1 or 0 a pixel; a NaN has no say. `reference` is width x height (CHECKed). O(pixels x reach^2).
std::vector<uint8_t> edgeMask(std::span<const double> reference, int width, int height, int reach = 2, double share = 1.0 / 3.0);

}  // namespace measure
}  // namespace gobo

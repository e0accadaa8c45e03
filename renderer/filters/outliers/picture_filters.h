// SPDX-License-Identifier: Apache-2.0
// Filters of whole pictures against outliers, by channel unless said otherwise: the weaker baselines of path density, since a pixel's samples are already
// mixed. RGB, width * height * 3; windows are cut off at the border.
#pragma once

#include <vector>

namespace gobo::outliers {

/// Median of (2 radius + 1)^2 pixels.
std::vector<float> medianFilter(const std::vector<float>& rgb, int width, int height, int radius = 1);

/// The median only where the value is further from it than `factor` times the median absolute deviation of the window (0.6745 standard deviations of a
/// Gaussian).
std::vector<float> medianOfOutliers(const std::vector<float>& rgb, int width, int height, int radius = 1, double factor = 1.0);

/// After Rushmeier & Ward 1994, "Energy preserving non-linear filters": what a pixel has beyond `factor` times the luminance of the median of its 3 x 3 is
/// spread evenly over a square that grows with it, until it is at most a tenth of that median or the square is 2 `most` + 1 wide. The sum over the picture
/// stays.
std::vector<float> spreadOutliers(const std::vector<float>& rgb, int width, int height, double factor = 2.0, int most = 16);

}  // namespace gobo::outliers

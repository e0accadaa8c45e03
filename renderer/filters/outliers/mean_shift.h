// SPDX-License-Identifier: Apache-2.0
// Mean-shift filtering (Comaniciu & Meer 2002, "Mean shift: a robust approach toward feature space analysis", section 4.1). RGB, width * height * 3.
#pragma once

#include "filters/outliers/sample_estimators.h"

namespace gobo::outliers {

struct MeanShift {
  double space = 4.0;  ///< radius of the window on the film, pixels; > 0
  double range = 8.0;  ///< radius of the window in CIELAB (path_density/metric.h); > 0
  float white = 1.0f;  ///< luminance of white, > 0
  int most = 50;       ///< steps, >= 1; few need more than ten
};

/// From its own place and colour each pixel goes to the mean place and colour of the pixels within both windows, until it stays, and takes the mean light of
/// those: means of RGB, where the source takes the colour itself. Pixels further apart than `range` never mix, spikes stay, and no sum is kept; all values are
/// means of the picture's. Pixels that are not finite count for nothing and stay. The same bits for any number of threads.
std::vector<float> meanShift(const std::vector<float>& rgb, int width, int height, const MeanShift& settings = {}, const Rows& rows = {});

}  // namespace gobo::outliers

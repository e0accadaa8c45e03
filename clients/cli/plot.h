// SPDX-License-Identifier: Apache-2.0
// A log-log scatter plot as a picture: speed against error without a plotting library. Pure function.
#pragma once

#include <string>
#include <vector>

#include "base/image.h"

namespace gobo::cli {

struct PlotPoint { double x, y, yError; };   ///< yError: drawn as a bar y +- yError

/// 640 x 480 linear RGB. Points not above zero are left out (a logarithm has no place for them).
Image plotLogLog(const std::vector<PlotPoint>& points, const std::string& xLabel, const std::string& yLabel);

}  // namespace gobo::cli

// SPDX-License-Identifier: Apache-2.0
#include "techniques/prefilter/environment_sums.h"

#include <algorithm>

#include "base/check.h"

namespace gobo::prefilter {

EnvironmentSums::EnvironmentSums(const Environment& map, const StopToken& stop)
    : width_(map.width), height_(map.height), sums_(size_t(map.width + 1) * size_t(map.height + 1), DVec3(0.0)), rowAngle_(size_t(map.height + 1), 0.0) {
  const EnvironmentTents tents(map.width, map.height);
  for (int y = 0; y < height_ && !stop.stopRequested(); ++y) {
    const double solid = tents.weight(y);
    rowAngle_[size_t(y) + 1] = rowAngle_[size_t(y)] + solid;
    DVec3 row(0.0);
    for (int x = 0; x < width_; ++x) {
      row += solid * DVec3(map.texels[size_t(y) * size_t(width_) + size_t(x)]);
      sums_[size_t(y + 1) * size_t(width_ + 1) + size_t(x + 1)] = at(x + 1, y) + row;
    }
  }
}

DVec3 EnvironmentSums::flux(int x0, int columns, int y0, int y1) const {
  GOBO_CHECK(columns >= 0 && columns <= width_ && y0 >= 0 && y0 <= y1 && y1 <= height_);
  const int left = ((x0 % width_) + width_) % width_, right = left + columns;
  DVec3 sum = between(left, std::min(right, width_), y0, y1);
  if (right > width_) sum += between(0, right - width_, y0, y1);
  for (int k = 0; k < 3; ++k) sum[k] = std::max(sum[k], 0.0);  // rounding
  return sum;
}

double EnvironmentSums::solidAngle(int columns, int y0, int y1) const { return columns * (rowAngle_[size_t(y1)] - rowAngle_[size_t(y0)]); }

DVec3 EnvironmentSums::mean(int x0, int columns, int y0, int y1) const {
  return columns > 0 && y1 > y0 ? flux(x0, columns, y0, y1) / solidAngle(columns, y0, y1) : DVec3(0.0);
}

}  // namespace gobo::prefilter

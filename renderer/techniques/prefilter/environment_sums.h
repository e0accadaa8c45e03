// SPDX-License-Identifier: Apache-2.0
// Sums over boxes of a lat-long map in constant time (a summed-area table, Crow 1984; of environments Hensley et al. 2005), in double: the flux and solid angle
// of any box of texels, which may wrap in azimuth, and their quotient, its mean radiance. Weights are those of the bilinear look-up
// (scene/environment_tents.h), so that the whole map has its flux. Errors are 1e-15 of the map's flux above the box's lower edge, not of the box's: in single
// precision one rounding would be 3 % of a box of 4 x 4 texels of a map of 4096 x 2048.
#pragma once

#include <vector>

#include "base/stop.h"
#include "scene/environment.h"
#include "scene/environment_tents.h"

namespace gobo::prefilter {

class EnvironmentSums {
 public:
  /// Of no use if `stop` fired. 24 bytes a texel.
  explicit EnvironmentSums(const Environment& map, const StopToken& stop = {});

  /// Columns x0 .. x0 + columns - 1 modulo the map's width, rows y0 .. y1 - 1. Columns in 0 .. width, rows within the map (CHECKed).
  DVec3 flux(int x0, int columns, int y0, int y1) const;  ///< W/m^2
  double solidAngle(int columns, int y0, int y1) const;   ///< sr
  /// Mean radiance; of an empty box 0.
  DVec3 mean(int x0, int columns, int y0, int y1) const;

 private:
  const DVec3& at(int x, int y) const { return sums_[size_t(y) * size_t(width_ + 1) + size_t(x)]; }
  DVec3 between(int x0, int x1, int y0, int y1) const { return (at(x1, y1) - at(x0, y1)) - (at(x1, y0) - at(x0, y0)); }
  int width_, height_;
  std::vector<DVec3> sums_;       // of what is left of and above a corner
  std::vector<double> rowAngle_;  // of the rows above, of one column
};

}  // namespace gobo::prefilter

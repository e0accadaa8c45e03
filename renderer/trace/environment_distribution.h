// SPDX-License-Identifier: Apache-2.0
// Sampling of an environment map in proportion to what it sends: texels with chance luminance x exact solid angle, then
// uniformly by solid angle inside the texel. With piecewise-constant look-up the density is luminance / total whatever the
// contrast. CDFs are double: a float sum over millions of texels loses the dim ones. 8 bytes a texel, two binary searches a
// sample (0.1 to 0.3 us for maps beyond the caches). Immutable; any thread may sample.
#pragma once

#include <vector>

#include "scene/environment.h"

namespace gobo {

class EnvironmentDistribution {
 public:
  explicit EnvironmentDistribution(EnvironmentPtr map);
  /// False for a black map. `direction` unit in world axes, radiance of the chosen texel, density over solid angle.
  bool sample(const Vec2& u, Vec3& direction, Vec3& radiance, float& pdf) const;
  float pdf(const Vec3& direction) const;
  /// Sum of luminance x solid angle, W m^-2 weighted by no cosine: the map's power as an importance.
  double total() const { return total_; }
  /// Exact solid angle of a texel of row y.
  double texelSolidAngle(int y) const;

 private:
  EnvironmentPtr map_;
  std::vector<double> rows_;      // inclusive prefix sums over rows
  std::vector<double> columns_;   // inclusive prefix sums of luminance inside each row
  std::vector<double> cosines_;   // of the rows' edges, h + 1
  double total_ = 0;
};

}  // namespace gobo

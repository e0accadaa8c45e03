// SPDX-License-Identifier: Apache-2.0
// Sampling of an environment map in proportion to what it sends. The bilinear look-up is a sum of tents (scene/environment_tents.h):
// a texel is drawn with chance luminance x the weight of its tent, then a direction in proportion to the tent. The sum of those
// densities is luminance / total, exactly, whatever the contrast: radiance over density is bounded by total (a colour's largest
// channel over its luminance apart). CDFs are double: a float sum over millions of texels loses the dim ones. 8 bytes a texel, two
// binary searches a sample (0.2 to 0.5 us for maps beyond the caches). Immutable; any thread may sample.
#pragma once

#include <optional>
#include <vector>

#include "base/stop.h"
#include "scene/environment_tents.h"

namespace gobo {
inline namespace trace {

class EnvironmentDistribution {
 public:
  /// `stop` is polled every row; a distribution whose making it ended is not to be used.
  explicit EnvironmentDistribution(EnvironmentPtr map, const StopToken& stop = {});
  /// False for a black map. `direction` unit in world axes, radiance from there, density over solid angle.
  bool sample(const Vec2& u, Vec3& direction, Vec3& radiance, float& pdf) const;
  float pdf(const Vec3& direction) const { return total_ > 0 ? pdfOf(map_->eval(direction)) : 0.0f; }
  /// The same of a direction from where `radiance` comes, as the map has it: a look-up saved where that is known.
  float pdfOf(const Vec3& radiance) const;
  /// Sum of luminance x solid angle, W m^-2 weighted by no cosine: the map's power as an importance.
  double total() const { return total_; }
  /// What a texel of row y has of the sphere, sr: the integral of its tent.
  double texelWeight(int y) const { return tents_->weight(y); }

 private:
  EnvironmentPtr map_;
  std::optional<EnvironmentTents> tents_;
  struct Azimuth {
    double cosine, sine;
  };
  std::vector<Azimuth> azimuths_;      // of the columns' centres, in the world
  std::vector<double> rows_;           // inclusive prefix sums over rows
  std::unique_ptr<double[]> columns_;  // inclusive prefix sums of luminance inside each row; not cleared first, which takes as long as the sums
  double total_ = 0;
};

}  // namespace trace
}  // namespace gobo

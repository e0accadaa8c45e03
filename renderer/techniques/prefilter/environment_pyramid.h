// SPDX-License-Identifier: Apache-2.0
// A map's mean radiance over pieces of the sphere of any size, for sums of few samples that each stand for a solid angle (filtered importance sampling,
// Krivanek, Colbert 2008). Octahedral squares of 512 x 512 to 4 x 4 texels, so that no direction is a pole; texels keep their solid angle, so that a level has
// the flux of the one above. Radiance is the map's bilinear look-up at the middles of parts of its texels. Map axes.
// Immutable; any thread.
#pragma once

#include <vector>

#include "base/stop.h"
#include "scene/environment.h"

namespace gobo::prefilter {

class EnvironmentPyramid {
 public:
  static constexpr int kSide = 512, kLevels = 8;
  /// Bytes of one while it is made.
  static constexpr size_t kBytes = size_t(kSide) * kSide * (4 * sizeof(double) + 2 * sizeof(Vec3));

  /// Empty if `stop` fired first.
  explicit EnvironmentPyramid(const Environment& map, const StopToken& stop = {});
  bool empty() const { return levels_.empty(); }
  /// About `direction` (unit), over about `solidAngle` sr: trilinear.
  Vec3 mean(const Vec3& direction, float solidAngle) const;
  /// Of a level's texels, and their integral over the sphere, W/m^2.
  DVec3 flux(int level) const;

 private:
  struct Level {
    int side = 0;
    std::vector<Vec3> radiance;
    std::vector<float> solidAngle;
  };
  static Vec3 lookUp(const Level& level, const Vec2& at);
  std::vector<Level> levels_;
};

}  // namespace gobo::prefilter

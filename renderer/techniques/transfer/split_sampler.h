// SPDX-License-Identifier: Apache-2.0
// The split of a map as a sampler of directions (the thesis of 2007 proposes it as future work; row 33 of its specification): a light in proportion to its
// luminous flux, uniform over its disk; what lights left by the cells of the cube. The density is that of the mixture, so that estimates are unbiased whatever
// the lights miss. Map axes. The path tracer draws from the map's own texels (trace/environment_distribution.h), which is the better sampler and has another
// cost: 8 bytes a texel and a pass over all of them, where this has some ten thousand numbers of a split that is there already. Compared by its test.
#pragma once

#include <vector>

#include "techniques/transfer/environment_split.h"

namespace gobo::transfer {

class SplitSampler {
 public:
  /// `map`: the one that `split` is of.
  SplitSampler(const EnvironmentSplit& split, const Environment& map);
  /// Unit direction; false for a black map. u in [0,1)^2.
  bool sample(const Vec2& u, DVec3& direction, double& density) const;
  /// Over solid angle.
  double density(const DVec3& direction) const;

 private:
  struct Disk {
    DVec3 direction;
    double cosine, chance, solidAngle;
  };
  std::vector<Disk> disks_;
  std::vector<double> cells_;  // inclusive prefix sums of the cells' chances, which follow those of the disks
  double inDisks_ = 0;
};

}  // namespace gobo::transfer

// SPDX-License-Identifier: Apache-2.0
// What an environment map is to environment.transfer, without a scene: its harmonics, the lights in it, and how much of it the harmonics miss. `gobo
// environment`.
#pragma once

#include "base/image.h"
#include "techniques/transfer/environment_split.h"

namespace gobo::transfer {

struct EnvironmentReport {
  /// Of a map, or of what no light took of it. Errors and extremes are by luminance, over texels of 0.7 degrees.
  struct Part {
    Image radiance, harmonics;  ///< 512 x 256 lat-long rgb, map axes: itself, and what its harmonics give there (perhaps below 0)
    double error = 0;           ///< L2 norm of the difference by that of `radiance`: 0 nothing missed, 1 all (0 of a black map)
    double least = 0;           ///< lowest value of `harmonics`, W/m^2/sr: where it is below 0 they overshoot
  };
  EnvironmentSplit split;
  double lightShare = 0;  ///< of the map's luminous flux, what is in lights
  Part whole, rest;
};

/// As environment.transfer splits it. The rotation of the map is not looked at. `full` of the split is empty if `stop` fired first.
EnvironmentReport reportEnvironment(const Environment& map, int bands, int lights, double share, const TaskArena& arena, const StopToken& stop = {});

}  // namespace gobo::transfer

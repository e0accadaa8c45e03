// SPDX-License-Identifier: Apache-2.0
// The environment seen through a wide cone: what a blurred background shows.
#pragma once

#include "scene/environment.h"

namespace gobo {
inline namespace scene {

/// The map convolved over the sphere with a Gaussian of the angle, exp(-angle^2 / (2 sigma^2)), cut off at 4 sigma; a constant map stays as it is, up to
/// rounding. `sigma`: radians, 0.5 .. 90 degrees. The result has a few texels a sigma and the map's rotation. Cost: O(texels of the map), and up
/// to half a second at 0.5 degrees, a hundredth from 20 on; the last few are kept. Null if `stop` fired first.
EnvironmentPtr blurredEnvironment(const Environment& map, double sigma, const StopToken& stop = {});

}  // namespace scene
}  // namespace gobo

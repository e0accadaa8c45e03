// SPDX-License-Identifier: Apache-2.0
// The background as a technique: it takes over what the camera sees of the environment, and brings a colour, the blurred map, or nothing in its place.
// The path tracer's nodes hold the map all the same, so that they are those of a request that shows it; what the camera sees of it is traced apart, by
// the same samples, and taken off their sums (filters/state_difference.h). So another background costs camera rays and nothing else.
#pragma once

#include "technique/technique.h"

namespace gobo {
inline namespace techniques {

const Technique& background();

}  // namespace techniques
}  // namespace gobo

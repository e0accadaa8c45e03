// SPDX-License-Identifier: Apache-2.0
// Light of the environment map by precomputed transfer (nodes.h): what the map gives to diffuse lobes, direct and after any number of bounces, without
// a ray when the map changes. Asked for by environment.transfer. What it does not claim (specular lobes, light from behind, the map itself where the
// camera sees it) stays the path tracer's.
#pragma once

#include "technique/technique.h"

namespace gobo {
inline namespace techniques {

const Technique& environmentTransfer();

}  // namespace techniques
}  // namespace gobo

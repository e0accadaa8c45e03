// SPDX-License-Identifier: Apache-2.0
// Lights at infinity in an environment map's place (environment.extract_lights: directions; environment.area_lights: squares and what they leave
// over, unshadowed): its direct light by their shadow techniques instead of by paths. What the camera and indirect paths see stays the map.
#pragma once

#include "technique/technique.h"

namespace gobo {
inline namespace techniques {

const Technique& environmentLights();

}  // namespace techniques
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Expander: k directional lights that stand for an environment map. Term "light_list", domain List, planes "direction" f32x3
// (towards the light, map axes: rotation 0) and "irradiance" f32x3 (W/m^2 for map scale 1). A small output: passed on by content.
// Method: greedy. Repeatedly take the brightest remaining texel-solid-angle product's neighbourhood: the map is cut into k
// cells by splitting the cell with the largest power at its power median along its longer side (median cut, Debevec 2005);
// each cell becomes a light at its power centroid carrying the whole cell's irradiance, so total power is conserved.
#pragma once

#include "terms/node.h"

namespace gobo {

NodePtr makeExtractLightsNode(int lights);

}  // namespace gobo

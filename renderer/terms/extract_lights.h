// SPDX-License-Identifier: Apache-2.0
// Expander: k directional lights that stand for an environment map. Term "light_list", domain List, planes "direction" f32x3
// (towards the light, map axes: rotation 0) and "irradiance" f32x3 (W/m^2 for map scale 1). A small output: passed on by content.
// Whatever finds them, all lights' irradiance together is the flux of the map, by channel.
//   MedianCut (Debevec 2005): greedy. The map is cut into k cells by splitting the cell with the largest power at its power median along its
//     longer side; each cell becomes a light at its power centroid.
//   Structured (structured_lights.h), Wavelet (wavelet_lights.h): lights at texels. A list's first lights are those of a shorter list, with other fluxes.
// Maps of fewer than 8 x 4 texels (a constant one has a single texel) are made 64 x 32 first by the bilinear look-up, their fluxes kept: texels are what has
// directions. Larger ones are taken as they are.
#pragma once

#include <span>

#include "terms/node.h"
#include "terms/texel_cells.h"

namespace gobo {
inline namespace terms {

enum class ExtractBy { MedianCut, Structured, Wavelet };

/// At most `lights`, fewer where fewer texels are lit. Deterministic for any arena; null: the caller's thread. Of no use after `stop` fired.
std::vector<MapLight> extractLights(const Environment& map, int lights, ExtractBy by, const TaskArena* arena = nullptr, const StopToken& stop = {});

/// The term "light_list" of lights that were found. Fluxes beyond single precision are its largest number.
TermPtr lightListTerm(std::span<const MapLight> lights);

/// `texels` of the map that it will be run on: for workingBytes() alone.
NodePtr makeExtractLightsNode(int lights, ExtractBy by = ExtractBy::MedianCut, size_t texels = 0);

}  // namespace terms
}  // namespace gobo

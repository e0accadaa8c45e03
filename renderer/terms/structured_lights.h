// SPDX-License-Identifier: Apache-2.0
// Structured importance sampling of an environment map (Agarwal, Ramamoorthi, Belongie, Jensen 2003), as a list that only grows:
//   1. Strata: texels between two thresholds of luminance (multiples of its standard deviation over the sphere) that touch. The map closes
//      in azimuth and over its poles. Black texels are in none.
//   2. A stratum's importance is flux^a x min(solid angle, 0.01 sr)^b, a = 1, b = 1/4: the light of a stratum that is smaller than what usually casts
//      shadows is hidden or not as a whole, and needs fewer lights than its flux asks for.
//   3. The next light goes to the stratum of the largest importance / (2 k + 1), k the lights that it has. The paper shares a given number out; by
//      this rule (Sainte-Lague's) the shares are the same but for rounding, and no stratum loses a light when the number grows.
//   4. In its stratum it goes to the texel that is farthest from every light so far (Hochbaum, Shmoys 1985). The first of a map, or of a stratum that
//      is compact, goes to the texel nearest to the stratum's centroid: a lamp's light is in its middle.
// Fluxes are those of Voronoi's cells (texel_cells.h). Fewer lights than asked for where fewer texels are lit; a black map has none.
#pragma once

#include "terms/texel_cells.h"

namespace gobo {
inline namespace terms {

struct StructuredSettings {
  int layers = 6;                     ///< thresholds at 0, 1, ... standard deviations
  double fluxPower = 1.0;             ///< a
  double solidAnglePower = 0.25;      ///< b
  double saturatedSolidAngle = 0.01;  ///< sr
};

/// Directions are centres of texels. At most 65 534 lights. Deterministic for any arena; null: the caller's thread. Of no use after `stop` fired.
std::vector<MapLight> structuredLights(const Environment& map, int lights, const TaskArena* arena = nullptr, const StopToken& stop = {},
                                       const StructuredSettings& settings = {});

/// The strata alone: for each texel its stratum, from 0 in the order of their first texels; none: kNoStratum. Empty if `stop` fired first.
inline constexpr uint32_t kNoStratum = ~uint32_t(0);
std::vector<uint32_t> brightnessStrata(const Environment& map, int layers, const StopToken& stop = {});

/// Bytes that structuredLights holds for a map of that many texels.
inline size_t structuredBytes(size_t texels) { return TexelCells::bytes(texels) + texels * 3 * sizeof(uint32_t); }

}  // namespace terms
}  // namespace gobo

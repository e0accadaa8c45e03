// SPDX-License-Identifier: Apache-2.0
// An environment as harmonics and lights. Peaks of the map become disks at infinity with sharp or soft shadows; harmonics hold the rest.
//   1. The map's cells (terms/environment_cells.h: exact fluxes), smoothed by a Gaussian of 3 degrees on a subdivided icosahedron of 10 242 vertices.
//   2. Local maxima there, climbed to from every vertex; the sources of a maximum are the cells nearest to it within 9 degrees.
//   3. A light is what of its cells rises above the local background, the mean radiance between 9 and 14 degrees about it: flux by channel, centre by
//      its first moment, radius by its second (a uniform disk of the same spread). What a light takes is taken out of the cells.
//   4. Then broad lamps (softboxes, windows, a glow about the sun), the same way in what is left: a Gaussian of 9 degrees, sources within 27, background
//   between 27 and
//      40; only those whose mean radiance is at least three times the map's, in full from six times, since a smooth sky's bright side is what harmonics are
//      for.
//   5. Lights that have less than a `share` of the map's luminous flux stay in the harmonics, faded out between share and twice share, so that
//      a sequence of maps does not pop. So at most 1 / share lights.
// Flux is exact: harmonics of the full map minus those of what was taken, cell by cell. The decomposition of the thesis of 2007 (4.1 - 4.5) adds lights to the
// projection of the whole map and so counts them twice (digest of seed 004, B11: +50 % for a sun of half the energy); this is its energy-exact form.
// Everything in map axes and double, in one order: a map that turns keeps its lights, bit for bit.
#pragma once

#include <vector>

#include "base/stop.h"
#include "base/task_arena.h"
#include "scene/environment.h"

namespace gobo::transfer {

/// Rec.709, in double: sums over maps of any contrast are weighted by it.
inline double luminanceOf(const DVec3& c) { return 0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z; }

struct SkyDisk {
  DVec3 direction{0, 1, 0};  ///< unit, towards it, map axes
  DVec3 flux{0.0};           ///< integral of its radiance, W/m^2
  DVec3 irradiance{0.0};     ///< on a plane facing it
  double radius = 0;         ///< half angle, radians
};

struct EnvironmentSplit {
  std::vector<double> full, rest;  ///< bands^2 x 3: the map, and without the lights
  std::vector<SkyDisk> lights;     ///< largest luminous flux first
  DVec3 flux{0.0};                 ///< of the map
  std::vector<double> left;        ///< of each cell's flux (terms/environment_cells.h), what no light took; empty: all of it
};

/// `lights` 0: harmonics alone. Nothing in it (empty `full`) if `stop` fired first.
EnvironmentSplit splitEnvironment(const Environment& map, int bands, int lights, double share, const TaskArena& arena, const StopToken& stop = {});

}  // namespace gobo::transfer

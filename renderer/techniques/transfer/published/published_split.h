// SPDX-License-Identifier: Apache-2.0
// The decomposition of an environment that the thesis of 2007 published, with the choices it describes or tried, to measure ours (environment_split.h) beside:
// a map is harmonics plus disks at infinity of one radiance each. Specification: digest of seed 004, B6 - B12. Nothing here renders.
//   1. The map's cells and exact harmonics, as ours. The harmonics through a window (windows.h).
//   2. Maxima of the smoothed map that the harmonics do not reach, with places between vertices and radii (peaks.h).
//   3. Those that become lights, and their power (light_powers.h); or by least squares, which for fixed disks also fits the harmonics anew.
// In map axes and double, in one order: the same bits for any number of threads.
#pragma once

#include <string>
#include <vector>

#include "base/stop.h"
#include "base/task_arena.h"
#include "scene/environment.h"
#include "techniques/transfer/published/light_powers.h"
#include "techniques/transfer/published/peaks.h"
#include "techniques/transfer/published/windows.h"

namespace gobo::transfer::published {

enum class Power {
  Published,    ///< beside the harmonics of the whole map: counts lights twice
  Residual,     ///< taken out of the harmonics; the window acts on what is left
  Least,        ///< least squares over the smoothed map at the vertices, of harmonics and disks together; powers of any sign, no window
  NonNegative,  ///< the same with powers that are not below 0
};

struct PublishedSettings {
  int bands = 5;  ///< 1 .. 10
  Window window = Window::None;
  PeakSettings peaks;
  double weber = 0.03;  ///< in (0, 1)
  size_t lights = 64;   ///< at most
  Power power = Power::Published;
};

struct PublishedSplit {
  std::vector<double> full, used;  ///< bands^2 x 3: of the map without a window, and what is rendered beside the lights
  std::vector<double> factors;     ///< of the window that `used` was multiplied by, by band
  double damping = 0;              ///< of Window::Least
  size_t candidates = 0;           ///< maxima that lights were chosen from
  std::vector<PublishedLight> lights;
  DVec3 flux{0.0};              ///< of the map, W/m^2
  DVec3 given{0.0};             ///< of `used` and the lights together
  std::vector<double> maximum;  ///< by number of lights, 0 .. all: largest luminance at a vertex between the smoothed map and `full` windowed with so many
                                ///< published lights, the order's own measure. Of other powers: one value, of `used` and all lights
  double squared = 0;           ///< L2 norm of that difference for `used` and all lights, by that of the smoothed map; 0 of a black one
  double least = 0;             ///< lowest luminance of `used` at a vertex, W/m^2/sr
};

/// Empty (`full`) if `stop` fired first. NaN, Inf and negative texels count as black (terms/environment_cells.h) where a map was made without repair.
PublishedSplit publishedSplit(const Environment& map, const PublishedSettings& settings, const TaskArena& arena, const StopToken& stop = {});

/// Irradiance of harmonics and lights on an unoccluded plane that faces `normal`, W/m^2: what a place in the open is given.
DVec3 openIrradiance(const std::vector<double>& harmonics, int bands, const std::vector<PublishedLight>& lights, const DVec3& normal);

}  // namespace gobo::transfer::published

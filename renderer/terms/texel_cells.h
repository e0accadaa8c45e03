// SPDX-License-Identifier: Apache-2.0
// Directional lights at texels of an environment map, each with the flux of the texels that lie nearest to it (cells of Voronoi's on the sphere).
// Fluxes are the bilinear look-up's (scene/environment_tents.h), so that all lights' together are the map's, by channel. The direction of a
// light does not depend on who else is there, so any first lights of a list are a list: only their fluxes are other ones.
// Map axes (rotation 0). Double inside, sums in the order of texels: the same bits for any threads.
#pragma once

#include <cstdint>
#include <vector>

#include "base/stop.h"
#include "base/task_arena.h"
#include "scene/environment.h"
#include "scene/environment_tents.h"

namespace gobo {
inline namespace terms {

struct MapLight {
  DVec3 direction{0.0};  ///< unit, towards it
  DVec3 flux{0.0};       ///< W/m^2: of a light without size, the irradiance of a plane that faces it
};

class TexelCells {
 public:
  /// Holds references to the map and the arena (null: the caller's thread).
  TexelCells(const Environment& map, const TaskArena* arena);

  /// A light at `texel` (row-major) takes what lies nearer to it than to the ones before. Of no use after `stop` fired.
  void add(uint32_t texel, const StopToken& stop);
  /// Cosine of the angle between a texel's centre and the nearest light; -2 if there is none.
  double nearest(size_t texel) const { return nearest_[texel]; }
  DVec3 direction(size_t texel) const;
  /// Integral of luminance over the texel's tent, W/m^2.
  double weight(size_t texel) const;
  double solidAngle(size_t texel) const { return tents_.weight(int(texel / size_t(map_.width))); }
  /// In the order of add().
  std::vector<MapLight> lights(const StopToken& stop) const;

  static constexpr double kEqual = 1e-14;  ///< cosines that differ by less are of equal angles: of two lights the first has the texel
  /// Bytes of a map of that many texels.
  static size_t bytes(size_t texels) { return texels * (sizeof(double) + sizeof(uint16_t)); }

 private:
  const Environment& map_;
  const TaskArena* arena_;
  EnvironmentTents tents_;
  std::vector<double> cosAzimuth_, sinAzimuth_, cosPolar_, sinPolar_;
  std::vector<double> nearest_, rowFarthest_;  // by texel; the least of a row
  std::vector<uint16_t> owner_;
  std::vector<uint32_t> texels_;  // of the lights
};

}  // namespace terms
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// An environment map gathered into the cells of a cube (6 x 64 x 64, about 1.4 degrees each): for every cell the flux of what lies in
// it with its first and second moments, so that what is fitted to the cells keeps sub-cell positions and sizes (a sun of half a degree
// lies where it lies). Map axes (rotation 0). Fine maps: texel by texel, each with the weight and the spread of its tent
// (scene/environment_tents.h); coarse ones are cut up. Either way fluxes are the bilinear look-up's. All sums in double, in one fixed order.
#pragma once

#include <vector>

#include "base/stop.h"
#include "base/task_arena.h"
#include "scene/environment.h"

namespace gobo {
inline namespace terms {

struct EnvironmentCell {
  double solidAngle = 0;  ///< of what was gathered, sr
  DVec3 flux{0.0};        ///< integral of radiance over them, W/m^2
  double weight = 0;      ///< luminance of `flux`
  DVec3 moment{0.0};      ///< integral of luminance x direction
  double extent = 0;      ///< integral of luminance x the piece's own mean squared radius about its centre
  /// Weighted mean direction: shorter than 1 by half the mean squared chord about it.
  DVec3 centre() const { return moment / weight; }
};

struct EnvironmentCells {
  static constexpr int kSide = 64;
  std::vector<EnvironmentCell> cells;  ///< face-major (0 +x, 1 -x, 2 +y, 3 -y, 4 +z, 5 -z), then row, then column
  DVec3 flux{0.0};                     ///< of the whole map
  double weight = 0;

  /// `stop` is polled every few rows; cells whose making it ended are not to be used. The same bits with an arena, whatever its threads, and without.
  explicit EnvironmentCells(const Environment& map, const StopToken& stop = {}, const TaskArena* arena = nullptr);
  /// Unit direction to tangent coordinates on `face`: x, y in [-1,1] on the face itself, growing beyond; false behind it.
  static bool project(int face, const DVec3& d, double& x, double& y);
  static DVec3 direction(int face, double x, double y);  ///< unit
  static DVec3 cellDirection(size_t cell);
  static int faceOf(const DVec3& d);

 private:
  void addTexels(const Environment& map, const StopToken& stop, const TaskArena* arena);  // texels narrower than half a cell: each in one place
  void addPieces(const Environment& map, const StopToken& stop, const TaskArena* arena);  // coarser maps: cut up
};

}  // namespace terms
}  // namespace gobo

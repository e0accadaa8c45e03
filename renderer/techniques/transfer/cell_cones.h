// SPDX-License-Identifier: Apache-2.0
// What an environment's cells (terms/environment_cells.h) look like from directions: the cells within an angle of one, their mean under a Gaussian at the
// vertices of an icosphere, and the maxima of that. What depends on constants alone (which cells, with which weights) is found once a process.
#pragma once

#include <vector>

#include "base/stop.h"
#include "base/task_arena.h"
#include "techniques/transfer/icosphere.h"
#include "terms/environment_cells.h"

namespace gobo::transfer {

/// Calls visit(cell, cosine of the angle between unit `d` and the cell's middle) for every cell whose middle is within `angle` (below 90 degrees), in the
/// order of cells. Only those of a box about the cone on each face are looked at.
template <typename Visit>
void cellsWithin(const DVec3& d, double angle, Visit&& visit);

/// Middles of all cells. The same object always.
const std::vector<DVec3>& cellDirections();

inline constexpr double kDegree = 3.14159265358979323846 / 180;
inline constexpr double kSmooth = 3 * kDegree, kSupport = 3 * kSmooth;
inline constexpr int kSmoothLevel = 5;  // edges of 2.0 to 2.4 degrees

/// Mean luminance of the map under a Gaussian of standard deviation `kSmooth` that ends at `kSupport`, at the vertices of icosphere(kSmoothLevel).
struct SmoothedMap {
  std::vector<double> value;   ///< luminance (radiance weighted) by vertex
  std::vector<double> within;  ///< luminous flux of the cells within kSupport, W/m^2: never too little, but a tenth too much perhaps
};
/// Empty if `stop` fired first. Weights are kept in single precision (8 MB, made by the first call), sums are double.
SmoothedMap smoothedCells(const EnvironmentCells& cells, const TaskArena& arena, const StopToken& stop = {});

/// The same for broad lamps, of what is `left` of each cell's flux: a Gaussian of kBroad over blocks of 4 x 4 cells, at the vertices of icosphere(kBroadLevel).
inline constexpr double kBroad = 9 * kDegree, kBroadSupport = 3 * kBroad;
inline constexpr int kBroadLevel = 4;  // edges of 4 to 4.8 degrees
SmoothedMap smoothedBlocks(const EnvironmentCells& cells, const std::vector<double>& left);

/// Where climbing to the largest neighbour ends, for every vertex; of equals the lower index, so that plateaus end too.
std::vector<int> climbed(const std::vector<double>& value, const Icosphere& sphere);

// ---------------------------------------------------------------------------------------------------------------------------------------------------

struct CellBox {
  int x0, x1, y0, y1;
};
/// The box of a face's cells that the cone may reach; false where it reaches none.
bool boxOfCone(int face, const DVec3& d, double angle, CellBox& box);

template <typename Visit>
void cellsWithin(const DVec3& d, double angle, Visit&& visit) {
  constexpr int n = EnvironmentCells::kSide;
  const std::vector<DVec3>& directions = cellDirections();
  const double least = std::cos(angle);
  for (int face = 0; face < 6; ++face) {
    CellBox b;
    if (!boxOfCone(face, d, angle, b)) continue;
    for (int y = b.y0; y <= b.y1; ++y)
      for (int x = b.x0; x <= b.x1; ++x) {
        const size_t i = (size_t(face) * n + size_t(y)) * n + size_t(x);
        const double cosine = glm::dot(d, directions[i]);
        if (cosine >= least) visit(i, cosine);
      }
  }
}

}  // namespace gobo::transfer

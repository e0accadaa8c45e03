// SPDX-License-Identifier: Apache-2.0
// Where the published decomposition puts lights, and how large: maxima of the smoothed map that its harmonics do not reach (digest of seed 004, B3, B7 - B10).
//   smoothed    mean radiance under a Gaussian of kSmooth that ends at kSupport, over the map's cells, each at the centre of its light
//   difference  luminance of the smoothed map less that of the harmonics, at the vertices of icosphere(kSmoothLevel)
//   candidates  maxima of the smoothed luminance, climbed to from every vertex, where the difference is above 0
#pragma once

#include <vector>

#include "base/stop.h"
#include "base/task_arena.h"
#include "techniques/transfer/cell_cones.h"
#include "techniques/transfer/published/refine.h"

namespace gobo::transfer::published {

/// How large a light is taken to be. Each but `Fixed` is of the difference about its maximum.
enum class Radius {
  Fixed,      ///< one for all
  Basin,      ///< a disk of the maximum's height holds what is above 0 in all of its basin (vertices that climb to it)
  Best,       ///< of 1, 1.5, .. 30 degrees that whose disk of the maximum's height misses least of the basin (L2)
  Curvature,  ///< a disk holds what the Gaussian of the maximum's height and curvature holds
};
inline constexpr double kLeastRadius = 0.5 * kDegree, kMostRadius = 60 * kDegree;

/// 2 pi (1 - cos R) of it is what a point-like source's Gaussian is divided by, so a disk as bright as its maximum has the source's flux: 4.22 degrees.
double kernelRadius();

/// The smoothed map. Light and solid angle of a cell are each taken to lie at their centre, which for uneven cells (texels are not cut at their edges) is not
/// the cell's middle: a constant stays one, and a point's Gaussian has its flux within 0.3 %.
class SmoothedRadiance {
 public:
  /// Of a map of `width` x `height` texels; keeps a reference to its cells. O(texels).
  SmoothedRadiance(const EnvironmentCells& cells, int width, int height, const TaskArena& arena);
  /// W/m^2/sr about a unit direction.
  DVec3 at(const DVec3& direction) const;
  /// At all vertices of icosphere(kSmoothLevel). Empty if `stop` fired first.
  std::vector<DVec3> atVertices(const TaskArena& arena, const StopToken& stop = {}) const;

 private:
  const EnvironmentCells& cells_;
  std::vector<DVec3> light_, open_;  // by cell: unit directions of the centres of its light and of its solid angle
};

/// Solid angle by vertex, a third of each triangle about it: 4 pi together.
std::vector<double> vertexAngles(const Icosphere& sphere);

struct Candidate {
  int vertex = 0;
  DVec3 direction{0, 1, 0};  ///< unit
  double difference = 0;     ///< luminance at the vertex, W/m^2/sr, above 0
  double radius = 0;         ///< half angle, radians, kLeastRadius .. kMostRadius
};
struct PeakSettings {
  Radius radius = Radius::Fixed;
  double fixed = 0;  ///< radians, of `Fixed` and where a maximum has no curvature; 0: kernelRadius()
  Refine refine = Refine::LogQuadric;
};
/// Largest difference first; of equals the lower vertex. Disks do not overlap: of two that would the one with the smaller difference is left out.
/// `smoothed` and `harmonics` at the vertices. Differences below 1e-5 of the mean of `smoothed` are rounding.
std::vector<Candidate> candidatesOf(const std::vector<DVec3>& smoothed, const std::vector<DVec3>& harmonics, const PeakSettings& settings);

}  // namespace gobo::transfer::published

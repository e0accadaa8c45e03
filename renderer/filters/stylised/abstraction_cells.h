// SPDX-License-Identifier: Apache-2.0
// The abstraction where a surface is smooth: over cells of 2 x 2, 4 x 4 ... samples in the place of samples, and interpolated between their middles.
//
// Computes     Cells hold the means of place, normal and distance by area. Each cell's Gaussian is summed over cells, narrower by the variance that a cell has
//              of itself (both add to sigma^2), and samples between four times four cells have the cubic through their values. Cells are as wide as can be up
//              to 0.56 of sigma (root of their area).
// Where        Cells and those around them are whole: each sample joined to its neighbours by onOneSurface, normals of neighbours within 5.7 degrees of each
//              other, and those of neighbouring cells within 4. Elsewhere (silhouettes, creases, bumps, a sigma of less than 3.6 pixels) `done` stays 0.
// Error        Interpolation 0.2 % of sigma at a ridge of the distance and none worth the name at an edge; half a cell from the picture's border, where values
//              go on beyond the last cells, some ten times that. A cell across a silhouette has the surface that it has most of; what it has of others is
//              missing in sums over it.
// Cost         Some 30 ns a sample for the cells, then 6 to 90 sums a sample.
#pragma once

#include <cstdint>
#include <span>

#include "filters/stylised/contour.h"

namespace gobo {
inline namespace filters {

struct AbstractionInput {
  const ContourInput& in;    ///< of one layer; no V
  std::span<const float> d;  ///< distances
  float sigma = 0;           ///< > 0
  float cosine = 0;          ///< of the guard
  bool counts(size_t e) const;
  /// Area that a sample stands for: of the parallelogram to its neighbours on the surface.
  float areaOf(int x, int y) const;
};

/// Sums of areas times distances stay in float: in units of sigma^2.
inline constexpr float kLeastAbstractionArea = 1e-30f, kMostAbstractionArea = 1e4f;

/// Sets `out` and `done` where the surface is smooth; false: stopped. `done` comes in as 0.
bool abstractByCells(const AbstractionInput& a, const TaskArena& arena, const StopToken& stop, std::span<float> out, std::span<uint8_t> done);
/// Of what it holds meanwhile.
size_t abstractionCellBytes(size_t samples);

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Wavelet importance sampling of an environment map alone (Clarberg, Jarosz, Akenine-Moeller, Jensen 2005; without the BRDF's factor), as a list that
// only grows: Sobol points of the unit square are warped down the Haar pyramid of luminance x solid angle, level by level, first between the rows and then
// between the columns of a node's four children. The paper's points are Hammersley's or of a similar set of a known number; Sobol's have no number.
// Points that fall into a texel that has a light add none: the list is the texels in the order in which they were first met.
// Fluxes are those of Voronoi's cells (texel_cells.h), exact by channel; points of equal weight would be exact in luminance alone.
// Fewer lights than asked for where a million points meet fewer texels; a black map has none.
#pragma once

#include "terms/texel_cells.h"

namespace gobo {
inline namespace terms {

/// Directions are centres of texels. At most 65 534 lights. Deterministic for any arena; null: the caller's thread. Of no use after `stop` fired.
std::vector<MapLight> waveletLights(const Environment& map, int lights, const TaskArena* arena = nullptr, const StopToken& stop = {});

/// Sums of luminance x solid angle over blocks of texels: each level half as wide and high as the one before, rounded up. They are the scaling
/// coefficients of the Haar basis without their normalisation; a node's three details are differences of its children.
class LuminancePyramid {
 public:
  explicit LuminancePyramid(const Environment& map, const StopToken& stop = {});
  double total() const { return levels_.back().sums[0]; }
  size_t lit() const { return lit_; }  ///< texels that are not black
  /// The texel that a point of the unit square is warped to. Its share of points is its share of the total; none has a share of 0. Total must be positive.
  uint32_t warp(double u, double v) const;

 private:
  struct Level {
    int width, height;
    std::vector<double> sums;
    double at(int x, int y) const { return x < width && y < height ? sums[size_t(y) * size_t(width) + size_t(x)] : 0.0; }
  };
  std::vector<Level> levels_;  // the map first
  size_t lit_ = 0;
};

/// Bytes that waveletLights holds for a map of that many texels.
inline size_t waveletBytes(size_t texels) { return TexelCells::bytes(texels) + texels * 2 * sizeof(double) + 4096; }

}  // namespace terms
}  // namespace gobo

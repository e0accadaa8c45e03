// SPDX-License-Identifier: Apache-2.0
// How many samples there are at a place of the film with a colour, without the samples: the film in square cells, each with a bounded number of bins of colour,
// and of every bin the number of its samples, the sum of their colours and of their squares. Bins are cubes of h_c / 2 or of that times a power of two: a cell
// that needs more bins than there is room for doubles theirs, and equal ones become one. So no sample is lost, and
//   the size of a cell's bins is the least at which all its samples fit,
// whichever order they came in. Sums are of whole numbers (1 / 64 h_c): exact, the same in any order, and a sample can be taken out of them again.
// Colours beyond 8192 h_c of zero are taken for that: none is near to them anyway.
// Memory: 48 bytes a bin, all from the beginning; it does not grow with samples.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "filters/path_density/neighbour_search.h"

namespace gobo::pathdensity {

/// A colour in 1 / 64 h_c.
using GridColour = std::array<int32_t, 3>;
GridColour gridColourOf(float l, float a, float b);

class ColourGrid {
 public:
  static constexpr int kFewestBins = 8;  ///< at the coarsest every colour is in one of so many

  /// cell: pixels along a side of a cell; bins: of a cell, at least kFewestBins.
  ColourGrid(int width, int height, int cell, int bins);

  int cell() const { return cell_; }
  int rows() const { return cellsY_; }
  size_t bytes() const;
  /// A sample of pixel (x, y). Different cells may be added to at the same time. False: the cell has as many as it can count (8 million).
  bool add(int x, int y, const GridColour& colour);
  /// After the last sample, before the first question: bins in an order that is not that of arrival.
  void settle(const TaskArena& arena);
  /// Bins that are as large as `colour`'s cell has them, in h_c.
  double binWidth(int x, int y) const;

  struct Scratch {
    std::vector<std::pair<float, uint32_t>> found;  ///< distance, how many
  };
  /// Mean distance (metric.h) of a sample, at (x, y) in pixels and itself counted, to the k nearest others, as far as bins tell: all of a bin at the mean
  /// distance of its colours and of an even cell, about. To all others where there are fewer, 0 where there is none. Exact between the bounds
  /// (neighbour_search.h), so far as that goes.
  float meanDistance(float x, float y, const GridColour& colour, int k, float filmScale, const OutcomeBounds& bounds, Scratch& scratch) const;

 private:
  struct Bin {
    std::array<int32_t, 3> key;
    uint32_t count;
    std::array<int64_t, 3> sum;
    int64_t squares;
  };
  size_t cellAt(int x, int y) const { return size_t(y / cell_) * size_t(cellsX_) + size_t(x / cell_); }
  GridColour keyOf(const GridColour& colour, size_t cell) const;
  void coarsen(size_t cell);
  void gather(int cx, int cy, float x, float y, const GridColour& colour, bool own, float perPixel, Scratch& scratch) const;

  int width_, height_, cell_, cellsX_, cellsY_, most_;
  std::vector<Bin> bins_;       // most_ a cell
  std::vector<uint16_t> used_;  // of a cell
  std::vector<uint32_t> held_;  // samples of a cell
  std::vector<uint8_t> level_;  // bins of 2^level / 2 h_c
};

}  // namespace gobo::pathdensity

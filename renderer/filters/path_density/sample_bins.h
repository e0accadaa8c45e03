// SPDX-License-Identifier: Apache-2.0
// Samples sorted by pixel, pixels by square cells of a few of them, cells row by row: a row of cells is one run of samples, and so is a pixel. Within a
// pixel samples keep their order. Cells have about eight samples or more where samples are spread evenly.
#pragma once

#include <cstdint>
#include <vector>

#include "base/stop.h"
#include "filters/path_density/path_samples.h"

namespace gobo::pathdensity {

struct SampleBins {
  int width = 0, height = 0;        ///< pixels
  int cell = 1;                     ///< pixels along a side of a cell
  int cellsX = 0, cellsY = 0;       ///< the last ones of a row and column may stick out of the picture
  std::vector<uint32_t> order;      ///< sorted -> the sample's index in its view
  std::vector<uint32_t> slotStart;  ///< of slot(x, y), in sorted order; one more at the end

  size_t slot(int x, int y) const {
    const size_t c = size_t(y / cell) * size_t(cellsX) + size_t(x / cell);
    return (c * size_t(cell) + size_t(y % cell)) * size_t(cell) + size_t(x % cell);
  }
  size_t pixelBegin(int x, int y) const { return slotStart[slot(x, y)]; }
  size_t pixelEnd(int x, int y) const { return slotStart[slot(x, y) + 1]; }
  /// Of cells [x0, x1] of row y.
  size_t cellsBegin(int x0, int y) const { return slotStart[(size_t(y) * size_t(cellsX) + size_t(x0)) * size_t(cell * cell)]; }
  size_t cellsEnd(int x1, int y) const { return slotStart[(size_t(y) * size_t(cellsX) + size_t(x1) + 1) * size_t(cell * cell)]; }
};

/// A view of up to 2^32 - 2 samples. Of no use once `stop` has fired.
SampleBins binSamples(const SampleView& samples, const StopToken& stop = {});

}  // namespace gobo::pathdensity

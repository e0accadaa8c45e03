// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/published/cube_wavelets.h"

#include <cmath>

#include "base/check.h"

namespace gobo::transfer::published {

CubeWavelets::CubeWavelets(int side, std::vector<double> solidAngles) : side_(side), angles_(std::move(solidAngles)), supports_(angles_) {
  GOBO_CHECK(side >= 1 && side <= kMostSide && (side & (side - 1)) == 0);
  const size_t across = size_t(side), cells = across * across;
  GOBO_CHECK(angles_.size() == 6 * cells);
  for (size_t face = 0; face < 6; ++face)
    for (size_t size = across; size > 1; size /= 2)
      for (const bool rows : {true, false}) {
        // Differences of rows are paired along columns too, as 2D wavelets are.
        const size_t step = across / size, along = rows ? step : step * across, between = rows ? step * across : step;
        for (size_t line = 0; line < size; ++line)
          for (size_t k = 0; k < size; k += 2) {
            const size_t first = face * cells + line * between + k * along, second = first + along;
            const double both = supports_[first] + supports_[second];
            if (both > 0) pairs_.push_back({uint32_t(first), uint32_t(second), std::sqrt(supports_[first] / both), std::sqrt(supports_[second] / both)});
            supports_[first] = supports_[second] = both;
          }
      }
}

}  // namespace gobo::transfer::published

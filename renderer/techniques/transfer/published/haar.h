// SPDX-License-Identifier: Apache-2.0
// A map's cells in Haar wavelets over the six faces of their cube, of which the largest are kept (Ng, Ramamoorthi, Hanrahan 2003; digest of seed 004, B12:
// what the thesis tried beside lights). Wavelets are orthonormal on the sphere (cube_wavelets.h), so the squared error is the sum of what is left out. Pure;
// any thread.
#pragma once

#include <cstdint>
#include <vector>

#include "techniques/transfer/published/cube_wavelets.h"
#include "terms/environment_cells.h"

namespace gobo::transfer::published {

struct HaarTerm {
  uint32_t index = 0;  ///< in the transformed cells: face, row, column
  DVec3 value{0.0};    ///< W/m^2/sr times the root of sr
};

class CubeHaar {
 public:
  explicit CubeHaar(const EnvironmentCells& cells);
  /// Largest luminance first, of equals the lower index. All 6 x 64 x 64.
  const std::vector<HaarTerm>& terms() const { return terms_; }
  /// L2 norm of the luminance that the first `count` terms miss, by that of the map's; 0 of a black map.
  double error(size_t count) const;
  /// Radiance by cell of the first `count` terms; may be below 0.
  std::vector<DVec3> radiance(size_t count) const;

 private:
  CubeWavelets wavelets_;
  std::vector<HaarTerm> terms_;
  std::vector<double> left_;  // squared luminance of terms from here on
};

}  // namespace gobo::transfer::published

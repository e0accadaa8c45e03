// SPDX-License-Identifier: Apache-2.0
// Summed-area table of mean and square of depth, in double: variance is a small difference of means, and 2^-16 of a 32-bit table would leave
// a standard deviation of 1/250 of the depth range undecided. Values are whole multiples of 2^-30, so that the sums of up to 2^24 texels are
// exact and a box is the same wherever its corners lie. Bytes: 16 a texel.
#pragma once

#include <span>

#include "filters/soft_shadow/soft_receivers.h"

namespace gobo {
inline namespace filters {

/// Filter, term "shadow_moment_sums": plane sums f64 x 2, (side + 1)^2 a face with zeroes in the first row and column. Input: a "light_depth_map".
NodePtr makeMomentSumsNode(int resolution, int faces);

class MomentSums {
 public:
  MomentSums(const Term& term, int resolution);  ///< a view
  static Extent extent(int resolution, int faces) { return {resolution + 1, resolution + 1, faces}; }
  /// Means of vsmFirst and vsmSecond over a box of piecewise constant texels.
  void box(int face, const SoftBox& box, float& first, float& second) const;

 private:
  const double* sums_;
  size_t row_, face_;
};

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Points of a contour, drawn by length, and the averaged distance's sum over them: the published Monte Carlo estimate (DeCoro 2009, section 3.3).
//
// Computes     Of N points y of the contour, uniform by length and independent of each other, the mean of |x - y|^-p over those whose normals are within
// `cosine`: times the
//              contour's length an unbiased estimate of the integral A of filters/stylised/averaged_distance.h.
// Numbers      Counter-based and independent (base/sobol.h, hash64): point k of a pixel is a pure function of the pixel's seed and k, so the first N of a
// larger N are the same.
//              Not a low-discrepancy sequence: its error would not follow the law that the method's sample counts go by.
// Numerics     double. Points are taken by batches; the sum is in units of the nearest point so far to the power -p and is scaled down when a nearer one comes,
// so that no power
//              leaves its range for p up to 64 and any scale.
// Cost         Building O(segments), 68 bytes each; some 20 ns a point, whatever the number of segments.
#pragma once

#include <vector>

#include "filters/stylised/contour.h"

namespace gobo {
inline namespace filters {

struct SampledSum {
  double unit2 = 0;   ///< square of the distance of the nearest point that is seen; 0: the point lies on the contour, and sum is of no use
  double sum = 0;     ///< of (r / unit)^-p over the points that are seen
  uint32_t seen = 0;  ///< points; 0: no others are of use
};

class ContourPoints {
 public:
  explicit ContourPoints(std::span<const ContourSegment> contour);

  /// Of the contour, scene units.
  double length() const { return length_; }
  /// Of a point x with unit normal n; `samples` points, drawn by `seed`. The contour's length is above 0.
  SampledSum sum(const Vec3& x, const Vec3& n, int p, float cosine, uint64_t seed, uint32_t samples) const;

 private:
  struct Line {
    Vec3 a{0.0f}, b{0.0f}, normal{0.0f};
    double begin = 0, perLength = 0;  ///< length of those before it; 1 / its own
  };
  std::vector<Line> lines_;
  std::vector<uint32_t> guide_;  ///< by equal parts of the length: the line in which each begins
  double length_ = 0;
};

}  // namespace filters
}  // namespace gobo

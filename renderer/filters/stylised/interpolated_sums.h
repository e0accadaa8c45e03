// SPDX-License-Identifier: Apache-2.0
// Sums over far sources at many points of a rectangle: at 8 x 8 Chebyshev nodes, and polynomials of degree 7 each way through them.
//
// Error        r^-p of a source at least `interpolationReach` half diagonals from the middle is analytic in a Bernstein ellipse about each side, and the bound
//              4 M rho^-n / (rho - 1) of both sides (Trefethen 2013, theorem 8.2; times the Lebesgue constant for one) is at most the error asked for, of each
//              source's least value in the rectangle. Points off the plane or beyond the rectangle are not meant.
// Numerics     float: coefficients of such a function fall fast, so that Horner's sum is as good as its largest term; what is seen is below 1e-5 of the sum.
#pragma once

#include <array>
#include <span>

#include "base/vec.h"

namespace gobo {
inline namespace filters {

struct PlaneRectangle {
  DVec3 centre{0.0}, s{1, 0, 0}, t{0, 1, 0};  ///< unit, at right angles
  double halfS = 0, halfT = 0;                ///< > 0

  double radius() const;
  DVec3 at(double u, double v) const { return centre + (u * halfS) * s + (v * halfT) * t; }
  /// The rectangle about points; sides that are 0 have a thousandth of the other's.
  static PlaneRectangle around(const DVec3& s, const DVec3& t, std::span<const DVec3> points);
};

/// Half diagonals from which on sources may be interpolated to `error` of each.
double interpolationReach(int p, double error);

struct InterpolatedSum {
  static constexpr size_t kSide = 8, kNodes = kSide * kSide;
  PlaneRectangle over;
  double unit2 = 1;                   ///< of the sum: square of the length that |x - y| is divided by
  double length = 0;                  ///< of the sources
  std::array<float, kNodes> share{};  ///< of u^i v^j at i * kSide + j

  static DVec3 node(const PlaneRectangle& over, size_t k);
  /// From the sum at each node.
  void fit(const std::array<double, kNodes>& values);
};

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// A simple shape of the plane: the superellipse |u/A|^q + |v/B|^q <= 1 with q = 2 / (1 - a), an ellipse for angularity a = 0, a rectangle for a = 1.
//
// Computes     Its signed distance, positive outside, by its support function h(phi) = ((A cos phi)^p + (B sin phi)^p)^(1/p), p = 2 / (1 + a): for convex
// shapes
//              it is  max over phi of |u| cos phi + |v| sin phi - h(phi),  0 <= phi <= 90 degrees, inside as outside. The rectangle's is its closed form.
// Error        The maximum is sought in a table of 25 directions (even by angle, and by the ellipse's own parameter, so that flat shapes have theirs), then
// bettered
//              by eight steps of regula falsi on its slope: within 1e-6 (A + |T|), never too large.
// Area         4 A B Gamma(1 + 1/q)^2 / Gamma(1 + 2/q). Variance along u is A^2 times a number of q alone, so A / B is the ratio of standard deviations.
// Cost         60 to 250 ns a distance; 430 bytes.
#pragma once

#include <array>

namespace gobo {
inline namespace filters {

class TargetShape {
 public:
  TargetShape() = default;
  /// A, B > 0; angularity 0 .. 1.
  TargetShape(double A, double B, double angularity);
  /// That of `area` whose standard deviations are as `alongU` to `alongV`; all positive.
  static TargetShape ofArea(double area, double alongU, double alongV, double angularity);
  double distance(double u, double v) const;
  double A() const { return A_; }
  double B() const { return B_; }
  /// Of a disc around it about its centre.
  double reach() const;
  static double areaOf(double A, double B, double angularity);

 private:
  double support(double c, double s) const;
  /// d h / d phi.
  double slope(double c, double s) const;

  static constexpr int kEach = 12, kDirections = 2 * kEach + 1;
  double A_ = 1, B_ = 1, p_ = 2;
  bool rectangle_ = false;
  std::array<float, kDirections> phi_{}, cos_{}, sin_{}, h_{};  ///< of A or B, whichever is larger
};

}  // namespace filters
}  // namespace gobo

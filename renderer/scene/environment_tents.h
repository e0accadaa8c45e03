// SPDX-License-Identifier: Apache-2.0
// Bilinear look-up of a lat-long map as a sum of texels times tents. Texel centres lie at ((x + 0.5) / width, (y + 0.5) / height); a
// tent falls to 0 at the centres of the neighbours. In azimuth the map wraps; beyond the centres of the outermost rows it is
// constant in the polar angle. So
//   radiance(direction) = sum over texels of texel(x, y) * tent_x(azimuth) * tent_y(polar angle),
// and whatever is linear in radiance (flux, importance, the density of samples) is a sum over texels with the weights below, exactly.
// Double inside: a polar row of a large map has a weight of 1e-8 sr. Pure; any thread.
#pragma once

#include <vector>

#include "base/stop.h"
#include "scene/environment.h"

namespace gobo {
inline namespace scene {

/// x, y: continuous texel coordinates, texel centres at half integers; x any number within a map's width of the map.
Vec3 interpolateTexels(const Environment& map, double x, double y);

class EnvironmentTents {
 public:
  EnvironmentTents(int width, int height);
  /// Integral over the sphere of the tent of a texel of row y, sr. All texels' together: 4 pi.
  double weight(int y) const { return (above(y) + below(y)) * azimuthStep_; }
  struct Polar {
    double angle, sine, cosine;  ///< 0 at +Y
  };
  /// Polar angle distributed as the tent of row y times the sine, from u in [0,1]; within 1e-12 of the inverse of its distribution.
  Polar polar(int y, double u) const;
  /// Azimuth from a texel's centre to the next one's, radians.
  double azimuthStep() const { return azimuthStep_; }
  /// Offset from a texel's centre in texels, in [-1,1], distributed as the tent, from u in [0,1].
  static double across(double u);

 private:
  double above(int y) const { return above_[size_t(y)]; }                // of the half towards +Y, without the azimuth
  double below(int y) const { return above_[size_t(height_ - 1 - y)]; }  // the sphere is symmetric
  struct Ramp;                                                           // half a tent against the sine
  /// A row's centre: its polar angle, and that one's sine and cosine.
  struct Row {
    double centre, sine, cosine;
  };
  Ramp ramp(double tau) const;
  int height_;
  double step_, azimuthStep_;  // between texel centres, radians
  std::vector<double> above_;
  std::vector<Row> rows_;                           // from +Y
  int terms_ = 0;                                   // of the series that ramp() sums; 0: rows too wide for few of them
  double cosineTerms_[6] = {}, sineTerms_[6] = {};  // (-1)^k step^2k / (2k)!, (-1)^k step^(2k + 1) / (2k + 1)!
};

/// Integral of luminance over the sphere, W m^-2 (without a cosine); 0 for a missing map. `stop` is polled every row: the sum is of no
/// use then.
double environmentFlux(const Environment* map, const StopToken& stop = {});

}  // namespace scene
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Irradiance of unshadowed planes from nine harmonics of a map, as a quadratic form of the normal (Ramamoorthi, Hanrahan 2001): E(n) = (n, 1)^T M (n, 1) for
// each channel, 16 products a look-up. Exact for maps of three bands; a light of one direction and irradiance 1 gives (0.375 + 2 x + 1.875 x^2) / 4, x the
// cosine, instead of max(x, 0): 1.06 at its peak and down to -0.04, which is left as it is.
#pragma once

#include <array>
#include <span>

#include "base/vec.h"

namespace gobo::prefilter {

struct IrradianceMatrix {
  std::array<DMat4, 3> channel{DMat4(0.0), DMat4(0.0), DMat4(0.0)};
  /// W/m^2 (of radiance in W m^-2 sr^-1). `normal`: unit, map axes.
  DVec3 at(const DVec3& normal) const;
};

/// From coefficients as techniques/transfer/environment_harmonics.h makes them: three bands x 3 channels, or the beginning of more.
IrradianceMatrix irradianceMatrix(std::span<const double> coefficients);

}  // namespace gobo::prefilter

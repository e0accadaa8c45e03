// SPDX-License-Identifier: Apache-2.0
// Windows over the bands of harmonics: what a peak makes them ring is damped, band by band. Specification: digest of seed 004, B6. Factors are of l alone, so
// a window is a convolution with a round kernel; that of band 0 is 1, so no flux is lost or made. Pure; any thread.
//   Hann     (1 + cos(pi l / L)) / 2
//   Lanczos  sin(pi l / L) / (pi l / L)
//   Least    1 / (1 + s l^2 (l + 1)^2), which is the smoothest fit for a given squared Laplacian (Sloan, Deringing Spherical Harmonics, 2017), with the
//            least s for which the harmonics are nowhere below 0
#pragma once

#include <vector>

#include "base/vec.h"

namespace gobo::transfer::published {

enum class Window { None, Hann, Lanczos, Least };

/// Factors of bands 0 .. bands - 1 (1 .. 10). Of `Least`: with `damping` s >= 0; the others take no note of it.
std::vector<double> windowFactors(Window window, int bands, double damping = 0);

/// `coefficients` (bands^2 x 3) times the factors of their bands.
std::vector<double> windowed(const std::vector<double>& coefficients, const std::vector<double>& factors);

/// What coefficients (bands^2 x 3) give in a direction, W/m^2/sr; may be below 0.
DVec3 radianceOf(const std::vector<double>& coefficients, int bands, const DVec3& direction);

/// The same at all vertices of icosphere(level), in their order.
std::vector<DVec3> radianceAtVertices(const std::vector<double>& coefficients, int bands, int level);

/// The least s of `Least` for which no channel of bands^2 x 3 coefficients is below 0 at a vertex of icosphere(level), within 0.1 %; 0 where none is without a
/// window. Channels share it, so that a window changes no hue. Where a channel's mean is negative itself no window helps: the largest s, 1e9.
double leastDamping(const std::vector<double>& coefficients, int bands, int level);

}  // namespace gobo::transfer::published

// SPDX-License-Identifier: Apache-2.0
// Real orthonormal spherical harmonics of up to ten bands about +Y, the axis that environment maps turn about: index l (l + 1) + m;
// m >= 0 goes with the cosine of m times the azimuth atan2(z, x), m < 0 with the sine of |m| times it. No Condon-Shortley phase. Pure; any thread.
#pragma once

#include <array>
#include <span>

#include "base/vec.h"

namespace gobo::transfer {

inline constexpr int kMaxBands = 10, kMaxHarmonics = kMaxBands * kMaxBands;
inline constexpr int kLanes = 16;

/// The first bands^2 of them at a unit direction. Errors below 1e-13.
void harmonics(const DVec3& direction, int bands, double* out);
/// The same at 16 directions in single precision: out[16 i + k] is number i at direction k. Errors below 2e-6.
void harmonics16(const float* x, const float* y, const float* z, int bands, float* out);
/// What convolution with the clamped cosine multiplies band l by: pi, 2 pi / 3, pi / 4, 0, -pi / 24, ... (Ramamoorthi & Hanrahan 2001).
double cosineCoefficient(int l);
/// Coefficients in the world's axes of a map that is turned by `rotation` radians (scene/environment.h), from those in its own. `channels` interleaved.
void turn(std::span<const float> map, int bands, int channels, double rotation, std::span<double> world);

}  // namespace gobo::transfer

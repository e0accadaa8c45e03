// SPDX-License-Identifier: Apache-2.0
// Which pixels a certificate looks at: where the picture itself says that it may be wrong, and everywhere else a little.
// Pure functions; derivation: docs/certificate.md.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/stop.h"

namespace gobo {
inline namespace measure {

// `stop` is polled at least every row; what a function gives that it ended is of no use.

/// How large a squared error the picture alone lets one expect, per pixel, up to a common factor: half (g - median)^2 and half
/// the mean of that over 5 x 5 pixels; g the mean of the channels, the median over the 24 neighbours (at borders the
/// nearest). `rgb` row-major, three floats a pixel. A pixel that is not finite counts as 0 (its neighbours' forecast is 0 too).
std::vector<float> forecastError(std::span<const float> rgb, int width, int height, const StopToken& stop = {});

/// Chance of every pixel to be drawn, sum = wanted (to 1e-6): proportional to the forecast, at least kEvenShare * wanted / N
/// and at most 1. 0 <= wanted <= N. Without a forecast above 0, or with wanted = N: the same for all.
inline constexpr double kEvenShare = 0.5;
std::vector<float> drawingChances(std::span<const float> forecast, double wanted, const StopToken& stop = {});

/// Draws pixels with exactly these chances, spread over the picture: ordered pivotal sampling (Deville & Tille, Biometrika 85,
/// 1998; Chauvet, Bernoulli 18, 2012) along a boustrophedon of nearly square blocks. The number drawn is the sum of the
/// chances, rounded up or down. Sorted by index. Depends only on its arguments. O(N).
std::vector<uint32_t> drawPixels(int width, int height, std::span<const float> chances, uint64_t seed, const StopToken& stop = {});

}  // namespace measure
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Which numbers of which sequence a pixel's camera rays are drawn by: for the path tracer, and for who traces the same rays.
#pragma once

#include <cstdint>

#include "base/sobol.h"

namespace gobo {
inline namespace trace {

/// The place inside the pixel.
inline constexpr uint32_t kDrawFilm = 0;
/// The lens' point, of the camera's ray alone: a set that no event has.
inline constexpr uint32_t kDrawLens = ~0u;

/// Of a pixel's samples in one of its independent sequences.
inline uint64_t pixelSeed(uint64_t seed, int x, int y, uint32_t stream) { return hash64(hash64(seed, uint64_t(uint32_t(y)) << 32 | uint32_t(x)), stream); }

}  // namespace trace
}  // namespace gobo

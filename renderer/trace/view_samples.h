// SPDX-License-Identifier: Apache-2.0
// Where the view samples of a pixel sit; shared by the tracer and by every term on the view-sample domain.
#pragma once

#include <cstdint>

#include "base/vec.h"

namespace gobo {
inline namespace trace {

/// Offset in [0,1)^2 of view sample s of S inside the pixel (S = 1: the centre). Owen-scrambled Sobol points with one fixed seed.
Vec2 viewSamplePosition(int s, int S);

/// Point of the unit disk that view sample s of S looks through where the camera has a lens, drawn by the pixel's place in the whole picture (so
/// that blurred things are noisy, not ghosts of S lenses).
Vec2 viewSampleLens(int s, int S, uint64_t pixel);

/// What a sample's number is to be raised by where its colour channel is the number modulo 3 and its view sample the number modulo `viewSamples` (0: none):
/// with 3, 6, 9 of them each would only ever be seen in one channel.
constexpr uint64_t channelTurn(uint64_t sample, uint64_t viewSamples) { return viewSamples > 0 && viewSamples % 3 == 0 ? sample / viewSamples : 0; }

}  // namespace trace
}  // namespace gobo

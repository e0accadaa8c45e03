// SPDX-License-Identifier: Apache-2.0
// Means over the part of a lens' blur that hardly shows.
#pragma once

#include <span>

#include "base/stop.h"
#include "base/task_arena.h"

namespace gobo::denoise {

/// Standard deviations of the Gaussian that its window holds.
inline constexpr float kBandReach = 2.5f;
/// Half width of the window, of Gaussians whose deviation is `share` of the blur.
int bandRadius(float share);

/// to[c][p] = sum_q w from[c][q] / sum_q w, w = exp(-|p - q|^2 / (2 s^2)), s = share * the smaller blur of both pixels, 0 beyond kBandReach s: what is sharp
/// gives nothing to its neighbours and takes nothing. planes: width * height each. Time: some ns a tap and pixel of those rows that are blurred as far. Each
/// sum goes from the top row to the last one and along rows, so that parts of pictures have the bits of the whole. False: stopped.
bool bandLimitedMeans(std::span<const float> blur, float share, int width, int height, std::span<const float* const> from, std::span<float* const> to,
                      const TaskArena& arena, const StopToken& stop);

}  // namespace gobo::denoise

// SPDX-License-Identifier: Apache-2.0
// A node of a denoiser.
#pragma once

#include "filters/denoise/denoiser.h"
#include "terms/node.h"

namespace gobo::denoise {

/// Inputs: features (features.h), noisy picture (noisy_picture.h, of the same counts). Output: "denoised", planes rgb f32x3: both halves by their shares;
/// a, b f32x3: each half alone. `judged`: by these halves; else a filter that does not look at them runs on the mean alone.
NodePtr makeDenoiseNode(DenoiserPtr denoiser, int width, int height, uint32_t samples, uint32_t first, bool judged = true);

}  // namespace gobo::denoise

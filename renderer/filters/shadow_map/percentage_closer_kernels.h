// SPDX-License-Identifier: Apache-2.0
// What depth bounds say about whole blocks of receivers whose kernel has one size: vectorised, because it decides most pixels.
#pragma once

#include <cstdint>

#include "filters/shadow_map/depth_bounds.h"
#include "filters/shadow_map/receivers.h"

namespace gobo {
inline namespace filters {

/// verdict[i]: 1 lit, 0 dark, 2 cannot tell, for the kernel of texels floor(x) - before .. floor(x) + after around receiver i, the same along y;
/// `bias` and `slopeBias` as receiverPlane() has them. Receivers that are not covered are lit. Conservative: 0 and 1 are what every comparison would say.
void kernelVerdicts(const DepthBounds& bounds, const ReceiverBlock& b, int count, int before, int after, float bias, float slopeBias, int32_t* verdict);

/// V of the bilinear comparison (REGULAR, 2 taps) for a block; `z`: the depth map, faces one after the other.
void bilinearComparisons(const float* z, int side, size_t faceTexels, const ReceiverBlock& b, int count, float bias, float slopeBias, float* V);

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace gobo::denoise {

/// w[t] = exp(-square * max(at[t], there[t])), 0 where the exponent is beyond `most`. at: 1 / (2 s^2) of pixels and of their neighbours.
void bandWeights(const float* at, const float* there, float square, float most, int n, float* w);

}  // namespace gobo::denoise

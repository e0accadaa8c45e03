// SPDX-License-Identifier: Apache-2.0
// Light within the blur of a lens (band_limit/blurred_means.h): bias grows with the square of `share`, noise falls with it. Blind for light itself: what is out
// of focus cannot be sharper than its disk. A pixel that shows something in focus keeps its light. Some 2 ns a pixel and tap of (2 bandRadius(share) + 1)^2.
#pragma once

#include "filters/denoise/denoiser.h"

namespace gobo::denoise {

/// share: of the disk's radius that the Gaussian's standard deviation is. 0.25 widens the disk's own deviation (half its radius) by an eighth.
DenoiserPtr makeLensFilter(float share);

}  // namespace gobo::denoise

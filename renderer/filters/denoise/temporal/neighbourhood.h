// SPDX-License-Identifier: Apache-2.0
// The range of light around a pixel on its surface, which history is held to.
#pragma once

#include "filters/denoise/temporal/reprojection.h"

namespace gobo::denoise {

struct LightRange {
  double mean[3] = {0, 0, 0}, variance[3] = {0, 0, 0};
  int pixels = 0;
};

/// Of `light` (RGB), over pixels of the same surface at most `radius` away along either axis, `p` among them. Light that is not finite is left out.
LightRange lightAround(const SeenSurfaces& seen, std::span<const float> light, size_t p, int radius, const SameSurface& by);

}  // namespace gobo::denoise

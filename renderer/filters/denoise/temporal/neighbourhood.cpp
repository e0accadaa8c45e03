// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/temporal/neighbourhood.h"

#include <algorithm>
#include <cmath>

namespace gobo::denoise {

LightRange lightAround(const SeenSurfaces& seen, std::span<const float> light, size_t p, int radius, const SameSurface& by) {
  const int x = int(p % size_t(seen.width)), y = int(p / size_t(seen.width));
  LightRange range;
  // Squares about the pixel's own light: those about 0 cancel where light is even and bright.
  double origin[3], squares[3] = {0, 0, 0};
  for (size_t c = 0; c < 3; ++c) origin[c] = std::isfinite(light[3 * p + c]) ? double(light[3 * p + c]) : 0.0;
  for (int qy = std::max(y - radius, 0); qy <= std::min(y + radius, seen.height - 1); ++qy)
    for (int qx = std::max(x - radius, 0); qx <= std::min(x + radius, seen.width - 1); ++qx) {
      const size_t q = size_t(qy) * size_t(seen.width) + size_t(qx);
      if (!std::isfinite(light[3 * q]) || !std::isfinite(light[3 * q + 1]) || !std::isfinite(light[3 * q + 2])) continue;
      if (q != p && !sameSurface(seen, p, seen, q, by)) continue;
      ++range.pixels;
      for (size_t c = 0; c < 3; ++c) {
        const double d = double(light[3 * q + c]) - origin[c];
        range.mean[c] += d;
        squares[c] += d * d;
      }
    }
  if (range.pixels == 0) return range;
  for (size_t c = 0; c < 3; ++c) {
    const double mean = range.mean[c] / range.pixels;
    range.variance[c] = std::max(squares[c] / range.pixels - mean * mean, 0.0);
    range.mean[c] = origin[c] + mean;
  }
  return range;
}

}  // namespace gobo::denoise

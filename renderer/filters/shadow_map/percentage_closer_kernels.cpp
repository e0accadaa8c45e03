// SPDX-License-Identifier: Apache-2.0
#include "filters/shadow_map/percentage_closer_kernels.h"

#include <algorithm>

#include "formulas/shadow_map.glsl.h"

namespace gobo {
inline namespace filters {

using formulas::absOf;

void kernelVerdicts(const DepthBounds& bounds, const ReceiverBlock& b, int count, int before, int after, float bias, float slopeBias,
                    int32_t* __restrict verdict) {
  int level = 0;
  while ((1 << level) < before + after + 1) ++level;  // texels as wide as the kernel: it meets at most two a side
  level = std::min(level, bounds.levels() - 1);
  const DepthBounds::Level l = bounds.level(level);
  const int last = bounds.resolution() - 1, side = l.side, shift = level;
  const float reach = float(std::max(before, after)) + 2.0f;
  int32_t at[4][ReceiverBlock::kSize];
  float lo[ReceiverBlock::kSize], hi[ReceiverBlock::kSize];
  for (int i = 0; i < count; ++i) {
    const int x = int(b.x[i]), y = int(b.y[i]);
    const int x0 = std::max(x - before, 0) >> shift, x1 = std::min(x + after, last) >> shift;
    const int y0 = std::max(y - before, 0) >> shift, y1 = std::min(y + after, last) >> shift;
    const int base = b.face[i] * int(bounds.faceTexels());
    at[0][i] = base + y0 * side + x0;
    at[1][i] = base + y0 * side + x1;
    at[2][i] = base + y1 * side + x0;
    at[3][i] = base + y1 * side + x1;
  }
  const float* __restrict low = l.lo;
  const float* __restrict high = l.hi;
  for (int i = 0; i < count; ++i) {
    const float a = std::min(low[at[0][i]], low[at[1][i]]), c = std::min(low[at[2][i]], low[at[3][i]]);
    const float e = std::max(high[at[0][i]], high[at[1][i]]), g = std::max(high[at[2][i]], high[at[3][i]]);
    lo[i] = std::min(a, c);
    hi[i] = std::max(e, g);
  }
  for (int i = 0; i < count; ++i) {
    const float slope = absOf(b.slopeX[i]) + absOf(b.slopeY[i]);
    const float d = b.d[i] - bias - slopeBias * 0.5f * slope, own = slope * reach + 1e-6f;
    const int lit = CHOOSE(d + own <= lo[i], 1, 0), dark = CHOOSE(d - own > hi[i], 1, 0);
    verdict[i] = CHOOSE((lit | (1 - b.covered[i])) != 0, 1, CHOOSE(dark != 0, 0, 2));
  }
}

void bilinearComparisons(const float* __restrict z, int side, size_t faceTexels, const ReceiverBlock& b, int count, float bias, float slopeBias,
                         float* __restrict V) {
  int32_t at[ReceiverBlock::kSize], right[ReceiverBlock::kSize], below[ReceiverBlock::kSize];
  float fx[ReceiverBlock::kSize], fy[ReceiverBlock::kSize], z00[ReceiverBlock::kSize], z10[ReceiverBlock::kSize], z01[ReceiverBlock::kSize],
      z11[ReceiverBlock::kSize];
  for (int i = 0; i < count; ++i) {
    const int x = int(b.x[i]), y = int(b.y[i]);
    fx[i] = b.x[i] - float(x);
    fy[i] = b.y[i] - float(y);
    at[i] = b.face[i] * int(faceTexels) + y * side + x;
    right[i] = CHOOSE(x + 1 < side, 1, 0);
    below[i] = CHOOSE(y + 1 < side, side, 0);
  }
  for (int i = 0; i < count; ++i) {
    z00[i] = z[at[i]];
    z10[i] = z[at[i] + right[i]];
    z01[i] = z[at[i] + below[i]];
    z11[i] = z[at[i] + below[i] + right[i]];
  }
  for (int i = 0; i < count; ++i) {
    const float sx = b.slopeX[i], sy = b.slopeY[i];
    const float d = b.d[i] - bias - slopeBias * 0.5f * (absOf(sx) + absOf(sy));
    // The receiver's plane at the four texels' centres (ReceiverPlane::at); a depth that is no number is lit.
    const float x0 = sx * -fx[i], x1 = sx * (1.0f - fx[i]), y0 = sy * -fy[i], y1 = sy * (1.0f - fy[i]);
    const float a = CHOOSE(z00[i] < d + (x0 + y0), 0.0f, 1.0f), c = CHOOSE(z10[i] < d + (x1 + y0), 0.0f, 1.0f);
    const float e = CHOOSE(z01[i] < d + (x0 + y1), 0.0f, 1.0f), g = CHOOSE(z11[i] < d + (x1 + y1), 0.0f, 1.0f);
    V[i] = CHOOSE(b.covered[i] != 0, formulas::shadowBilinear(a, c, e, g, fx[i], fy[i]), 1.0f);
  }
}

}  // namespace filters
}  // namespace gobo

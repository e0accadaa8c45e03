// SPDX-License-Identifier: Apache-2.0
// Loops of the depth rasteriser over the texels of one row. Values q grow towards the light: 1 / depth (perspective), which is linear
// on the map's plane, or -depth (orthographic).
#pragma once

#include <cstddef>
#include <cstdint>

namespace gobo {
inline namespace filters {

/// A triangle's q along a row: at texel i it is start + i step, limited to what its corners span.
struct DepthSpan {
  float start, step, lo, hi;
};
/// q[i] = max(q[i], span at i).
void nearestSpan(float* q, size_t n, const DepthSpan& span);
/// open[i] = 1 where the span at i lies at q[i] or in front of it.
void openSpan(const float* q, uint8_t* open, size_t n, const DepthSpan& span);
/// Linear depth in [0,1] from q; `nothing` gives 1.
void resolvePerspective(const float* q, float* z, size_t n, float near, float scale, float nothing);
void resolveOrthographic(const float* q, float* z, size_t n, float near, float scale, float nothing);

}  // namespace filters
}  // namespace gobo

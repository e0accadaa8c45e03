// SPDX-License-Identifier: Apache-2.0
#include "filters/shadow_map/depth_raster_kernels.h"

#include "formulas/shadow_map.glsl.h"

namespace gobo {
inline namespace filters {
namespace {

inline float spanAt(const DepthSpan& s, int i) {
  const float v = s.start + s.step * float(i), low = v < s.lo ? s.lo : v;
  return low > s.hi ? s.hi : low;
}

}  // namespace

void nearestSpan(float* __restrict q, size_t n, const DepthSpan& span) {
  const DepthSpan s = span;
  for (int i = 0; i < int(n); ++i) {
    const float v = spanAt(s, i);
    q[i] = q[i] > v ? q[i] : v;
  }
}

void openSpan(const float* __restrict q, uint8_t* __restrict open, size_t n, const DepthSpan& span) {
  const DepthSpan s = span;
  for (int i = 0; i < int(n); ++i) open[i] |= uint8_t(spanAt(s, i) >= q[i]);
}

void resolvePerspective(const float* __restrict q, float* __restrict z, size_t n, float near, float scale, float nothing) {
  for (size_t i = 0; i < n; ++i) {
    const float d = formulas::shadowDepth((1.0f / q[i] - near) * scale);
    z[i] = q[i] > nothing ? d : 1.0f;
  }
}

void resolveOrthographic(const float* __restrict q, float* __restrict z, size_t n, float near, float scale, float nothing) {
  for (size_t i = 0; i < n; ++i) {
    const float d = formulas::shadowDepth((-q[i] - near) * scale);
    z[i] = q[i] > nothing ? d : 1.0f;
  }
}

}  // namespace filters
}  // namespace gobo

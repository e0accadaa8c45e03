// SPDX-License-Identifier: Apache-2.0
#include <bit>
#include <cmath>
#include <cstdint>

#include "filters/path_density/metric.h"

namespace gobo::pathdensity {

namespace {

/// Of t >= 0.008: an estimate from the exponent, then Halley's steps (each cubes the relative error of 0.05).
inline float labCubeRoot(float t) {
  float y = std::bit_cast<float>(std::bit_cast<uint32_t>(t) / 3u + 709921077u);
  for (int i = 0; i < 2; ++i) {
    const float c = y * y * y;
    y = y * ((c + 2.0f * t) / (2.0f * c + t));
  }
  return y;
}
inline float labCurve(float t) {
  constexpr float kKnee = 216.0f / 24389.0f;
  const float m = std::fabs(t);
  const float curved = labCubeRoot(m < kKnee ? kKnee : m) - 4.0f / 29.0f, straight = m * (841.0f / 108.0f);
  return std::copysign(m > kKnee ? curved : straight, t) + 4.0f / 29.0f;
}

}  // namespace

void labOf(float* __restrict r, float* __restrict g, float* __restrict b, int n) {
  for (int i = 0; i < n; ++i) {
    const float x = (0.4124564f * r[i] + 0.3575761f * g[i] + 0.1804375f * b[i]) * (1.0f / 0.95047f);
    const float y = 0.2126729f * r[i] + 0.7151522f * g[i] + 0.0721750f * b[i];
    const float z = (0.0193339f * r[i] + 0.1191920f * g[i] + 0.9503041f * b[i]) * (1.0f / 1.08883f);
    const float fx = labCurve(x), fy = labCurve(y), fz = labCurve(z);
    r[i] = 116.0f * fy - 16.0f;
    g[i] = 500.0f * (fx - fy);
    b[i] = 200.0f * (fy - fz);
  }
}

}  // namespace gobo::pathdensity

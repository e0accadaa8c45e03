// SPDX-License-Identifier: Apache-2.0
// Vectorised loops of the exponential shadow map on the cpu, and what the *.comp kernels share with them: weights and layout.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "filters/exponential_shadow_map/exponential_shadow_map.h"

namespace gobo {

/// 2 radius + 1 Gaussian weights, sigma = (2 radius + 1) / 4, that sum to 1.
std::vector<float> exponentialShadowWeights(int radius);

/// e[i] = e^{c (z[i] - 1)}.
void encodeExponential(const float* z, float* e, size_t n, float c);
/// out[x] = sum_k weights[k] padded[x + k], k ascending; `padded` has n + taps - 1 values.
void filterRow(const float* padded, const float* weights, int taps, float* out, int n);
/// out[x] = sum_k weights[k] rows[k][x], k ascending.
void filterColumns(const float* const* rows, const float* weights, int taps, float* out, int n);

/// Push constants of the lookup shader; the cpu loop reads the same struct.
struct ExponentialLookupParameters {
  float u[4], v[4], w[4], d[4];
  float origin[3];
  float c, bias;
  int32_t width, height;
  uint32_t count;
};
static_assert(sizeof(ExponentialLookupParameters) == 96);
ExponentialLookupParameters lookupParameters(const ExponentialShadowLookup& lookup, int width, int height, uint32_t count);

/// V of `count` receivers: positions 3 floats each, instance ~0u means no surface.
void lookupExponential(const ExponentialLookupParameters& p, const float* map, const float* positions, const uint32_t* instances, float* visibility,
                       size_t count);

}  // namespace gobo

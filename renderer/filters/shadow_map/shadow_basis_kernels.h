// SPDX-License-Identifier: Apache-2.0
// Vectorised loops of the shadow bases: formulas/*_shadow_map.glsl.h over arrays. Layouts as in ShadowBasis.
#pragma once

#include <cstddef>

#include "filters/shadow_map/shadow_basis.h"

namespace gobo {
inline namespace filters {

inline constexpr int kMaxConvolutionOrder = 32;

void encodeDepth(const float* z, float* out, size_t n);
void encodeExponential(const float* z, float* out, size_t n, float c);
void reconstructExponential(const float* e, const float* d, float* s, size_t n, float c);
/// From L, the logarithmically filtered depth: e^{c (L - d)}.
void reconstructExponentialDepth(const float* depth, const float* d, float* s, size_t n, float c);

void encodeVariance(const float* z, float* out, size_t n);
void reconstructVariance(const float* values, size_t stride, const float* d, float* s, size_t n, float minVariance, float cut);

void encodeExponentialVariance(const float* z, float* out, size_t n, float cPositive, float cNegative);
void reconstructExponentialVariance(const float* values, size_t stride, const float* d, float* s, size_t n, float cPositive, float cNegative, float minVariance,
                                    float cut);

void encodeMoments(const float* z, float* out, size_t n);
void reconstructMoments(const float* values, size_t stride, const float* d, float* s, size_t n, float bias, float cut);

/// scaling: s = scale f; otherwise s = 1/2 + scale (f - 1/2), with the receiver at d - offset.
struct ConvolutionParameters {
  int order;
  float attenuation, scale, offset;
  bool scaling;
};
/// 2 order values a texel: sin(c_k z), cos(c_k z), k ascending.
void encodeConvolution(const float* z, float* out, size_t n, int order);
/// sum of the terms without the constant: f - 1/2, before scale.
void convolutionSeries(const float* values, size_t stride, const float* d, float* sum, size_t n, const ConvolutionParameters& p);
void reconstructConvolution(const float* values, size_t stride, const float* d, float* s, size_t n, const ConvolutionParameters& p);

}  // namespace filters
}  // namespace gobo

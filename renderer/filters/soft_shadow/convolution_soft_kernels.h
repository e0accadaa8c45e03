// SPDX-License-Identifier: Apache-2.0
// Loops of convolution soft shadow maps.
#pragma once

#include "filters/shadow_map/shadow_basis_kernels.h"

namespace gobo {
inline namespace filters {

/// 4 order + 1 values a texel: those of encodeConvolution, z times each, z.
void encodeConvolutionSoft(const float* z, float* out, size_t n, int order);

/// What a kernel that holds nothing but the receiver's own plane reads: the mean of fbar, and of z fbar, over a box whose half widths change the
/// plane's depth by x[i] and y[i] depth ranges. In closed form: the mean of sin(c (t + o)) over t = x u + y v, u, v in [-1,1], is
/// sin(c o) sinc(c x) sinc(c y). The plane lies `shift` behind d.
void convolutionSelf(const float* x, const float* y, const float* d, const float* shift, float* self, float* selfDepth, size_t n,
                     const ConvolutionParameters& p);

/// What one blocker at depth z reads: fbar(d, z).
void convolutionFull(const float* z, const float* d, float* full, size_t n, const ConvolutionParameters& p);

/// Blocked share (unclamped) and sum of the blockers' depths from filtered images: values[k * stride + i], 4 order + 1 of them (eq. 8.8),
/// less what the receiver's own plane contributes.
void convolutionBlockers(const float* values, size_t stride, const float* d, const float* self, const float* selfDepth, float* blocked, float* depth, size_t n,
                         const ConvolutionParameters& p);

}  // namespace filters
}  // namespace gobo

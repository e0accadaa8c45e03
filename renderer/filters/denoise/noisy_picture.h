// SPDX-License-Identifier: Apache-2.0
// The input of denoisers: a picture apart from its textures, in two halves, with its variance.
#pragma once

#include "filters/denoise/denoiser.h"
#include "terms/node.h"

namespace gobo::denoise {

/// Half width of the window over which variance is smoothed.
inline constexpr int kVarianceRadius = 3;

/// Inputs: features; if `samples` > 1 a picture (plane "rgb", 3) of the first `first` samples of each pixel, 0 < first < samples; the one of `samples`.
/// Output: "noisy_picture", planes mean, a, b, variance f32x3 (denoiser.h); demodulated light beyond 1e18 counts as that.
/// `curvature`: one more input, a picture (plane "rgb") of how light bends (trace/curvature_sums.h), and one more plane, curvature f32: its mean over channels,
/// demodulated, from 0 to 1e30.
/// Variance of the mean from the halves: (a - b)^2 m (n - m) / n^2, m of n samples being in a; exact in the mean if they are independent. Halves of one
/// Owen-scrambled sequence fill each other's gaps, so that it is mostly too large. One number a pixel says little (its own relative error is 1.4): it is
/// averaged over pixels within kVarianceRadius with like normals, on one plane. A picture of one sample a pixel has the variance of these pixels.
NodePtr makeNoisyPictureNode(int width, int height, uint32_t samples, uint32_t first, bool curvature = false);

/// The planes of both terms; they have to live as long.
NoisyPicture noisyPicture(const Term& features, const Term& noisy, uint32_t samples, uint32_t first);

}  // namespace gobo::denoise

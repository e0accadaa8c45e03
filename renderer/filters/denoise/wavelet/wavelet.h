// SPDX-License-Identifier: Apache-2.0
// Edge-avoiding a-trous wavelets (Dammertz, Sewtz, Hanika, Lensch 2010) whose colour weights follow the variance (Schied et al. 2017, the spatial part).
//   L_k+1(p) = sum_q h(q - p) w_k(p, q) L_k(q) / sum_q h(q - p) w_k(p, q),   h: 5 x 5 taps of the B3 spline, 2^k pixels apart, k < levels
//   w_k(p, q) = max(0, n_p . n_q)^normal_power  exp(-|n_p . (x_q - x_p)| / (plane_px footprint_p |q - p|))  exp(-|l(q) - l(p)| / (luminance sigma(p)))
// with w_k(p, p) = 1; l: luminance of the guide, filtered along; sigma^2: its variance, blurred by the taps 1 2 1 in both directions. Unlike the paper:
// - Variance. The taps of a coarse level hold partly the same pixels, so that their variance falls by 4 a level, not by the sum of squares (13). We take
//     v_k+1 = (1 - c_k) sum (h w)^2 v_k / (sum h w)^2 + c_k sum h w v_k / sum h w,
//   c_k such that it is exact where all w are 1: 0 at the first level, 0.19 or so after it. Where weights follow the noise (luminance 4) what is left of it
//   is about 1.6 times v: at the first level a pixel that errs much has few like it.
// - Nothing is added to sigma: pixels without noise keep all differences. Planes and normals are those of means over the view samples.
// - A pixel that shows no surface mixes with its like only. One whose normals cancel out stays as it is.
// Variance of the luminance from that of the channels: as if they erred together, (sum of shares and deviations)^2.
//
// Guides. Mean: weights by the luminance of all samples, used for both halves: half the time, and the least error. But (outA - b)^2 - var(b) is no measure of
// the error of outA then: b has a say in what a is averaged with, and where light changes about as much as it is noisy the estimate is too low by more than the
// error itself. Weights for a from b alone do no better (they pick pixels by b's noise). Own: each half by its own luminance; the estimate is off by
// 3 to 16 % (the variance is of both), outliers are kept more often, at twice the time.
//
// Parameters: levels (2^(levels + 1) - 2 pixels to each side), luminance (less keeps outliers, more blurs shadows), normal_power, plane_px. The defaults are
// about the best on the Cornell box from 1 to 64 samples; luminance alone matters there. Cost: 24 taps a level for both halves, in rows of arrays
// (wavelet_kernels.h). Memory: 25 floats a pixel. It fails where noise is larger than the variance says, which averages over 7 x 7 pixels: pictures of one
// sample a pixel that are mostly black. Light is lost where few pixels carry much of it (1 to 6 % on the Cornell box), since they stay apart. Light that falls
// steeply, near a lamp, is blurred while it is noisy.
#pragma once

#include "filters/denoise/denoiser.h"
#include "gobo/v1/filters.pb.h"

namespace gobo::denoise {

/// Whose luminance the weights of a half come from.
enum class WaveletGuide { Mean, Own };

DenoiserPtr makeWavelet(const v1::WaveletDenoise& settings, WaveletGuide guide = WaveletGuide::Mean);

}  // namespace gobo::denoise

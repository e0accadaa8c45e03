// SPDX-License-Identifier: Apache-2.0
// Non-local means between two halves of the samples (Rousselle, Knaus, Zwicker 2012, "Adaptive rendering with non-local means filtering"; with features,
// Rousselle, Manzi, Zwicker 2013, "Robust denoising using feature and color information").
//   out_a(p) = sum_q w_b(p, q) a(q) / sum_q w_b(p, q)   over the window |p - q| <= radius, and b with the weights of a:
//   w_g(p, q) = exp(-max(0, mean over the patch's pixels and channels of  ((g_p - g_q)^2 - v_p - min(v_p, v_q)) / (k^2 (v_p + v_q) + e))) s(p, q)
// g: the guide half, v: its variance, k: damping, s: similarity of what the camera sees (similar.h), wider with larger `features`. A half is not weighed by
// its own noise, so that a pixel that no other resembles is averaged all the same, and bright outliers do not keep themselves.
// Cost: (2 radius + 1)^2 offsets, each a distance, a separable box of the patch and an exponential for both halves. Convex. Patches reach over the
// picture's edge by repeating its pixels; the window does not.
// Weak where patches are noise alone (few samples, thin features) and at the finest detail of light, which has no patch like it.
#pragma once

#include "filters/denoise/denoiser.h"
#include "gobo/v1/filters.pb.h"

namespace gobo::denoise {

DenoiserPtr makeNonLocalMeans(const v1::NonLocalMeansDenoise& settings);

}  // namespace gobo::denoise

// SPDX-License-Identifier: Apache-2.0
// Of several denoised pictures the one that errs least, pixel by pixel (denoise.auto), from the samples alone.
// Candidate k has halves a_k, b_k, made of the samples in a and in b, which are independent of each other. The expected square of its error, less what all
// candidates have in common, is that of
//   s_k = ((a_k - b)^2 + (b_k - a)^2) / 2 - (a_k - b_k)^2 / 4
// (halves of equal count; else by their shares), since E (a_k - b)^2 is the error of a_k, squared, and the variance of b, and the mean of both halves has
// half the variance of one. The noisy picture
// itself is a candidate: where every filter errs more than the noise is, nothing is filtered. s_k alone is noise, so it is summed over a Gaussian window
// (half width kSelectRadius), each pixel by the inverse of its variance and of 3 % of the mean one around. The choices (1 for the least) are blurred over
// kBlendRadius pixels and blend the candidates, so that there are no seams. Convex in the candidates. What it does not know: errors that a_k and b have in
// common, as where no sample found a light.
#pragma once

#include "terms/node.h"

namespace gobo::denoise {

inline constexpr int kSelectRadius = 6, kBlendRadius = 3;

/// Inputs: noisy picture (noisy_picture.h, with halves); `candidates` terms "denoised" (denoise_node.h). Output: "denoised", plane rgb f32x3, and
/// "choice" f32 [candidates + 1]: shares of the noisy picture and of each candidate. `shareOfA`: of the samples.
/// Cost: about 30 ns a pixel and candidate.
NodePtr makeSelectNode(int width, int height, int candidates, float shareOfA);

}  // namespace gobo::denoise

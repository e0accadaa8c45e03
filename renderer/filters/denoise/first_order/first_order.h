// SPDX-License-Identifier: Apache-2.0
// Nonlinearly weighted first-order regression (Bitterli, Rousselle, Moon, Iglesias-Guitian, Adler, Mitchell, Jarosz, Novak 2016), collaborative.
// At each pixel p light is fitted, over the window, by an affine function of what the camera sees without noise: albedo, normal, depth (differences to p;
// depth in widths of the window):
//   sum_q w(p, q) (L(q) - b_0 - b . (x_q - x_p))^2 + ridge W sum_j b_j^2  ->  least,    W = sum_q w
// w: patch weights of the other half (non_local_means.h, same distance). The fit at p predicts every pixel of its window, and a pixel is the mean of what the
// fits around it predict, by the same weights. A fit predicts between 0 and four times its weighted mean (the same below 0 for negative light).
// `ridge` = 0.001: a feature that varies by less than some 3 % in the window explains little, and one that does not vary nothing: no system is singular.
// Keeps detail that is in features, where means blur it; costs (2 radius + 1)^2 times 60 products a pixel and half, and the patch weights twice. Needs
// 24 floats a pixel. Float sums over at most 33^2 pixels, solved in double: within 1e-3 of a fit in double (DenoiseFirstOrder.IsTheFitOfItsDefinition).
#pragma once

#include "filters/denoise/denoiser.h"
#include "gobo/v1/filters.pb.h"

namespace gobo::denoise {

DenoiserPtr makeFirstOrder(const v1::FirstOrderDenoise& settings);

}  // namespace gobo::denoise

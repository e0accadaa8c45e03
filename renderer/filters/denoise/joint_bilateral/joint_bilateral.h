// SPDX-License-Identifier: Apache-2.0
// Joint bilateral filter (Petschnigg et al. 2004; Eisemann, Durand 2004) of demodulated light, whose range weights come from what the camera sees
// without noise: albedo, angle between normals, distance from the tangent plane. It knows nothing of the light itself: shadows are blurred over the
// window, highlights as well. The baseline that others have to beat.
//   out(p) = sum_q g(|p - q|) s(p, q) in(q) / sum_q g(|p - q|) s(p, q),   g Gaussian of standard deviation radius / 2, s: similar.h
// (2 radius + 1)^2 weights a pixel, used for both halves. Convex: the result is within the range of its input.
#pragma once

#include "filters/denoise/denoiser.h"
#include "gobo/v1/filters.pb.h"

namespace gobo::denoise {

DenoiserPtr makeJointBilateral(const v1::JointBilateralDenoise& settings);

}  // namespace gobo::denoise

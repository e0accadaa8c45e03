// SPDX-License-Identifier: Apache-2.0
// Edge-avoiding a-trous wavelets (Dammertz, Sewtz, Hanika, Lensch 2010) whose colour weights follow the variance (Schied et al. 2017, the spatial part).
// TODO
#pragma once

#include "filters/denoise/denoiser.h"
#include "gobo/v1/filters.pb.h"

namespace gobo::denoise {

/// Whose luminance the weights of a half come from.
enum class WaveletGuide { Mean, Cross };

DenoiserPtr makeWavelet(const v1::WaveletDenoise& settings, WaveletGuide guide = WaveletGuide::Mean);

}  // namespace gobo::denoise

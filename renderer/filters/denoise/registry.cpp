// SPDX-License-Identifier: Apache-2.0
// The list of denoisers: a line each.
#include "filters/denoise/registry.h"

#include "filters/denoise/axis_aligned/axis_aligned.h"
#include "filters/denoise/first_order/first_order.h"
#include "filters/denoise/joint_bilateral/joint_bilateral.h"
#include "filters/denoise/non_local_means/non_local_means.h"
#include "filters/denoise/wavelet/wavelet.h"

namespace gobo::denoise {

Result<DenoiserPtr> makeDenoiser(const v1::Denoise& settings) {
  switch (settings.filter_case()) {
    case v1::Denoise::kJointBilateral: return makeJointBilateral(settings.joint_bilateral());
    case v1::Denoise::kWavelet: return makeWavelet(settings.wavelet());
    case v1::Denoise::kNonLocalMeans: return makeNonLocalMeans(settings.non_local_means());
    case v1::Denoise::kAuto: return internalError("denoise.auto names several filters", "request.denoise");
    case v1::Denoise::kFirstOrder: return makeFirstOrder(settings.first_order());
    case v1::Denoise::kAxisAligned: return makeAxisAligned(settings.axis_aligned());
    case v1::Denoise::FILTER_NOT_SET: break;
  }
  return DenoiserPtr();
}

}  // namespace gobo::denoise

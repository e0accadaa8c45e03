// SPDX-License-Identifier: Apache-2.0
// denoise_bench --temporal: a light that moves, frame by frame; the error of each filter and how it flickers.
#pragma once

#include <string>
#include <vector>

#include "plan/engine.h"

namespace gobo::bench {

struct OverTime {
  uint32_t frames = 64, samples = 4, reference = 64;  ///< reference: each half
  double travel = 1;                                  ///< share of the light's way, about its middle; 0: it rests
  double leastShare = 0.1;                            ///< of accumulation (filters/denoise/temporal)
};

/// A row a filter, printed. `request`: scene, size and settings. Filters as in denoise_bench, and among the parts between + one "temporal" or
/// "temporal.clamp": accumulation (filters/denoise/temporal), of what the parts before it make, with those behind it on its result.
Status measureOverTime(Engine& engine, const RenderControl& control, const v1::RenderRequest& request, const std::vector<std::string>& filters,
                       const OverTime& how);

}  // namespace gobo::bench

// SPDX-License-Identifier: Apache-2.0
// Slices: a picture with a shutter is the mean of the pictures of its moments, each planned as one (plan/moment.h).
#pragma once

#include "plan/planner.h"
#include "plan/window.h"

namespace gobo {
inline namespace plan {

/// Each slice of the shutter's interval as the picture of its moment, and what they are together. Bytes that may be held beside what the nodes say. Errors:
/// ResourceExhausted (poses).
Result<uint64_t> planSlices(Plan& plan, const ScenePtr& base, const v1::RenderRequest& request, uint32_t passes, const PixelWindow& window,
                            const PlannerServices& services);

}  // namespace plan
}  // namespace gobo

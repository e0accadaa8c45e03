// SPDX-License-Identifier: Apache-2.0
// Embree filter callbacks for Mask and Blend surfaces. Stateless; called from any tracing thread.
#pragma once

#include "trace/embree.h"

namespace gobo {
inline namespace trace {
/// Rejects hits on uncovered texels. Geometry user data is an AlphaGeometry. Serves intersect and occluded filters, any packet size.
void alphaFilter(const RTCFilterFunctionNArguments* args);
}  // namespace trace
}  // namespace gobo

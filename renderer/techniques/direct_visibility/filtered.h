// SPDX-License-Identifier: Apache-2.0
// Filters of a request on the visibility of a light, before light is made of it (request.filters, docs/picture_filters.md).
#pragma once

#include <string>

#include "technique/plan_context.h"

namespace gobo {
inline namespace techniques {

/// `v`, a term with plane "V" of the light that requests know as `light`, behind the filters of visibility:LIGHT; shares stay shares. v: there are none.
NodeId planFilteredVisibility(PlanContext& context, NodeId v, const std::string& light);

}  // namespace techniques
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Direct light as unoccluded light times visibility, for lights with a shadow technique (filters/shadow_technique.h): its front by filters, what
// passes surfaces from behind by paths. Lights of a cluster are folded into one plane.
#pragma once

#include "technique/technique.h"

namespace gobo {
inline namespace techniques {

const Technique& directVisibility();

}  // namespace techniques
}  // namespace gobo

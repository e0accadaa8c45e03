// SPDX-License-Identifier: Apache-2.0
// Direct light of lights that stand for an environment, each with a visibility of its own, folded into one plane a lobe.
#pragma once

#include <cstdint>
#include <vector>

#include "technique/plan_context.h"

namespace gobo {
inline namespace techniques {

/// Lights `first` to the last of `extended`, at their powers times `nominal`; `group` is the map's. Shadows: what the request names for the light
/// "environment", else `samples` rays. Their terms are kept while all of them take up at most 256 MB.
Status foldLights(PlanContext& context, const ScenePtr& extended, int first, const Vec3& nominal, int group, uint32_t samples,
                  const std::vector<LobePart>& lobes);

}  // namespace techniques
}  // namespace gobo

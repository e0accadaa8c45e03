// SPDX-License-Identifier: Apache-2.0
// The peaks that an environment is split from (environment_split.h), as lights with shadows of their own.
#pragma once

#include <string>
#include <vector>

#include "technique/plan_context.h"

namespace gobo::transfer {

/// "; lights of it with shadows of their own: ...", for a plan's row. `split`: term "environment_split".
std::string apartText(const Term& split);

/// Direct light of the lights of `split`, folded into one plane a lobe. Null while only bounded: then of `most`. `map`: the environment among the scene's
/// lights.
Status planSplitLights(PlanContext& context, const TermPtr& split, int map, int most, const std::vector<LobePart>& lobes);

}  // namespace gobo::transfer

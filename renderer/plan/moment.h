// SPDX-License-Identifier: Apache-2.0
// Moment: a picture of one moment, what is asked of it and the scene as it is then; and the nodes that it is made of. A picture without shutter is one
// moment, one with a shutter several (plan/slices.h).
#pragma once

#include <algorithm>
#include <string>
#include <vector>

#include "plan/outputs.h"
#include "plan/planner.h"
#include "plan/window.h"

namespace gobo {
inline namespace plan {

/// A sky, as the request has it and as a map.
struct Sky {
  std::string settings;
  EnvironmentPtr map;
};

/// A picture of one moment: what is asked of it, and the scene as it is then.
struct Moment {
  v1::RenderRequest request;
  EffectiveScene effective;
  RelightGroups groups;
  Sky sky;
  SequenceShare share;
  uint64_t sharedSeed = 0;
  bool lens = false;  ///< the camera may have one in some moment of the picture
};

/// Moment k of a shutter's, or the only one there is. `before`: the sky of another one, or none. Errors: those of the effective scene; Cancelled.
Result<Moment> momentOf(const ScenePtr& base, const v1::RenderRequest& request, uint32_t k, const Sky& before, const PlannerServices& services);

/// Nodes and outputs of a window of the picture of a moment; of no width: all of it. Bytes that may be held beside what the nodes say. `planes`: of the same
/// outputs, in their order.
Result<uint64_t> planMoment(Plan& plan, std::vector<PlannedOutput>& planned, std::vector<OutputPlane>& planes, const ScenePtr& base, const Moment& moment,
                            uint32_t passes, const PixelWindow& window, const PlannerServices& services);

inline const OutputInfo& infoOf(const std::string& output) { return *findOutput(output); }

template <typename T>
void addNew(std::vector<T>& to, const std::vector<T>& from) {
  for (const T& t : from)
    if (std::find(to.begin(), to.end(), t) == to.end()) to.push_back(t);
}

}  // namespace plan
}  // namespace gobo

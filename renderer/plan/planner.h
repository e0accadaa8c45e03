// SPDX-License-Identifier: Apache-2.0
// Planner: a resolved request becomes a graph of nodes and the pictures to read from it. It asks the registered techniques (technique/technique.h) for
// the beauty and each output's row (plan/outputs.h) for its plane, and knows none of them by name. Pure but for `expand`, by which a node is
// evaluated while planning (its result decides which nodes follow).
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "request/effective_scene.h"
#include "technique/technique.h"
#include "terms/graph.h"

namespace gobo {
inline namespace plan {

struct PlannedOutput {
  std::string name;
  NodeId node = -1;
  std::string plane;
  std::vector<std::string> channels;  ///< EXR channel names
};

struct Plan {
  Graph graph;
  EffectiveScene effective;
  RelightGroups groups;
  std::vector<PlannedOutput> outputs;
  std::vector<NodeId> expanded;      ///< nodes whose results decided, or would decide, what follows
  bool extendable = false;           ///< some node takes more samples
  bool mattesGrow = false;           ///< mattes of more samples have more rays
  std::vector<std::string> missing;  ///< "indirect (environment)": classes that no term of the beauty holds; and paths that none finds (classesNotCovered)
  std::vector<std::string> warnings;
  uint64_t pinnedBytes = 0;  ///< upper bound of bytes held at once while it runs (plan/live_bytes.h)
};

/// The last sky of an engine: whoever asks for the same one again (a camera that moves, a light that is tuned) does not wait for its map to be computed.
/// One map, of 1.5 MiB. Any thread.
class LastSky {
 public:
  /// Of these settings (v1::Sky, serialised), or null.
  EnvironmentPtr find(const std::string& settings) const;
  void keep(const std::string& settings, EnvironmentPtr map);
  uint64_t bytes() const;
  void drop() { keep({}, nullptr); }

 private:
  mutable std::mutex mutex_;
  std::string settings_;
  EnvironmentPtr map_;
};

struct PlannerServices {
  /// Who brings light, in the order of summation.
  std::span<const Technique* const> techniques = registeredTechniques();
  EnvironmentLoader loadEnvironment;
  ScenePoser poseScene = requestedScene;
  LastSky* lastSky = nullptr;  ///< null: none is kept
  /// Empty: the plan is a bound of what the real one holds, for which no node runs.
  std::function<Result<TermPtr>(const Graph&, NodeId)> expand;
  StopToken stop;  ///< ends planning (Cancelled); loadEnvironment and expand have their own
};

/// `request` must be resolved (request/request.h). `passes` of path-traced nodes: trace/sample_passes.h; of a shutter (request/shutter.h): of each slice. Of
/// such a plan `effective` and `groups` are those of the slice in the middle.
Result<std::unique_ptr<Plan>> makePlan(const ScenePtr& base, const v1::RenderRequest& request, uint32_t passes, const PlannerServices& services);

}  // namespace plan
}  // namespace gobo

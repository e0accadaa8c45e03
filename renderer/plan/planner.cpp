// SPDX-License-Identifier: Apache-2.0
#include "plan/planner.h"

#include <optional>

#include "filters/crop.h"
#include "plan/live_bytes.h"
#include "plan/moment.h"
#include "plan/slices.h"
#include "plan/window.h"
#include "request/shutter.h"

namespace gobo {
inline namespace plan {

namespace {

/// Nodes and outputs of a window of the picture; of no width: all of it. Bytes that may be held beside what the nodes say. `only`: the one moment of a picture
/// without slices, kept for the next call.
Result<uint64_t> planNodes(Plan& plan, std::optional<Moment>& only, const ScenePtr& base, const v1::RenderRequest& request, uint32_t passes,
                           const PixelWindow& window, const PlannerServices& services) {
  uint64_t reserved = 0;
  if (hasShutter(request) && !mayMove(*base, request))
    addNew(plan.warnings, {"request.camera.shutter_s: nothing moves, for the scene has no animation and the request no curves"});
  else if (const uint32_t slices = shutterSlices(request); hasShutter(request) && slices < request.camera().shutter_slices())
    addNew(plan.warnings, {"request.halt.spp = " + std::to_string(request.halt().spp()) + ": of request.camera.shutter_slices = " +
                           std::to_string(request.camera().shutter_slices()) + " there are " + std::to_string(slices)});
  if (shutterSlices(request) > 1) {
    GOBO_ASSIGN(reserved, planSlices(plan, base, request, passes, window, services));
  } else {
    if (!only) { GOBO_ASSIGN(only, momentOf(base, request, 0, {}, services)); }
    std::vector<OutputPlane> planes;
    GOBO_ASSIGN(reserved, planMoment(plan, plan.outputs, planes, base, *only, passes, window, services));
  }
  for (NodeId i = 0; i < plan.graph.size(); ++i) plan.extendable = plan.extendable || plan.graph.at(i).node->traits().extendable;
  return reserved;
}

}  // namespace

Result<std::unique_ptr<Plan>> makePlan(const ScenePtr& base, const v1::RenderRequest& request, uint32_t passes, const PlannerServices& services) {
  auto plan = std::make_unique<Plan>();
  GOBO_ASSIGN(PixelWindow window, windowOf(request));
  if (window.width == int(request.width()) && window.height == int(request.height())) window = {};  // shares its terms
  std::optional<Moment> only;
  GOBO_ASSIGN(uint64_t reserved, planNodes(*plan, only, base, request, passes, window, services));
  std::vector<NodeId> kept;
  for (const PlannedOutput& o : plan->outputs) kept.push_back(o.node);
  int halo = 0;
  if (window.width) { GOBO_ASSIGN(halo, haloOf(plan->graph, kept, {window.width, window.height, 1})); }
  if (halo > 0) {  // again, with what its filters look at around it
    const PixelWindow around = grown(window, halo, int(request.width()), int(request.height()));
    plan->graph = Graph();
    plan->outputs.clear();
    plan->expanded.clear();
    plan->missing.clear();
    plan->warnings.clear();
    const bool all = around.width == int(request.width()) && around.height == int(request.height());  // shares its terms
    GOBO_ASSIGN(reserved, planNodes(*plan, only, base, request, passes, all ? PixelWindow{} : around, services));
    kept.clear();
    const std::vector<bool> ofView = nodesOfView(plan->graph, {around.width, around.height, 1});
    for (PlannedOutput& o : plan->outputs) {
      if (ofView[size_t(o.node)])
        o.node = plan->graph.add({makeCropNode({around.width, around.height, 1}, window.x - around.x, window.y - around.y, window.width, window.height),
                                  {o.node},
                                  {},
                                  kCropNode + o.name});
      kept.push_back(o.node);
    }
    GOBO_TRY(plan->graph.wiring());
  }
  if (only) {
    plan->effective = std::move(only->effective);
    plan->groups = std::move(only->groups);
  }
  plan->pinnedBytes = mostLiveBytes(plan->graph, kept, plan->expanded) + reserved;
  return plan;
}

}  // namespace plan
}  // namespace gobo

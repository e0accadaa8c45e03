// SPDX-License-Identifier: Apache-2.0
#include "plan/planner.h"

#include "filters/crop.h"
#include "plan/live_bytes.h"
#include "plan/output_plans.h"
#include "plan/outputs.h"
#include "plan/window.h"
#include "technique/plan_context.h"
#include "trace/reach.h"

namespace gobo {

namespace {

const OutputInfo& infoOf(const std::string& output) { return *findOutput(output); }

/// Classes that nobody brings, by relight group.
void reportMissing(const PlanContext& c, std::vector<std::string>& missing) {
  for (int g = 0; g < c.groups().count; ++g) {
    bool anyVisible = false;
    PathSet covered = PathSet::None;
    for (int l : c.groups().members[size_t(g)]) {
      const Light& light = c.scene()->lights[size_t(l)];
      anyVisible = anyVisible || rayReaches(light.shape, light.cameraVisible, Receiver::Camera, Passage::Open);
      covered = covered | c.cover().claimed(l);
    }
    if (!contains(covered, PathSet::Direct)) missing.push_back("direct (" + c.groupName(g) + ")");
    if (anyVisible && !contains(covered, PathSet::Emission)) missing.push_back("emission (" + c.groupName(g) + ")");
    if (!contains(covered, PathSet::Indirect)) missing.push_back("indirect (" + c.groupName(g) + ")");
  }
}

/// Through a lens only light that is traced from it is right.
Status checkLens(PlanContext& c, std::span<const Technique* const> techniques) {
  if (!c.view().camera.hasLens()) return {};
  for (const Technique* t : techniques)
    for (int l = 0; l < int(c.scene()->lights.size()) && !t->seesThroughLens(); ++l)
      if (c.cover().claimedBy(l, t->name()) != PathSet::None)
        return invalidArgument("request.camera: a lens needs path-traced light, and '" + c.scene()->lights[size_t(l)].name + "' comes by " + t->name() +
                                   ": leave out the lens, or the light's shadow technique and the environment's area_lights and transfer",
                               c.request().camera().has_f_number() ? "request.camera.f_number" : "request.camera.lens_radius");
  return {};
}

Status planBeauty(PlanContext& c, std::span<const Technique* const> techniques) {
  if (c.scene()->lights.empty() && !c.kinds().unlit && !c.effective().background.scene) {
    c.prune("beauty", "the scene has no light");
    c.warn("the picture is black: the scene has no light, and the request brings none");
  }
  for (const Technique* t : techniques) GOBO_TRY(t->claim(c));
  GOBO_TRY(checkLens(c, techniques));
  for (const Technique* t : techniques) GOBO_TRY(t->plan(c));
  return c.cover().complete();
}

/// Nodes and outputs of a window of the picture; of no width: all of it. Bytes that may be held beside what the nodes say.
Result<uint64_t> planNodes(Plan& plan, const ScenePtr& base, const v1::RenderRequest& request, uint32_t passes, const PixelWindow& window,
                           const PlannerServices& services) {
  Distinctions apart;
  bool beauty = false;
  for (const std::string& o : request.outputs()) {
    apart.classes = apart.classes || needsClasses(infoOf(o)) || (request.has_denoise() && needsRadiance(infoOf(o)));
    apart.lobes = apart.lobes || needsLobes(infoOf(o));
    apart.variance = apart.variance || o == "variance";
    apart.curvature = apart.curvature || (needsCurvature(request.denoise()) && needsRadiance(infoOf(o)));
    apart.seen = std::max(apart.seen, infoOf(o).seen);
    beauty = beauty || needsRadiance(infoOf(o));
  }
  PlanContext context({request, plan.effective, plan.groups, passes, window, apart, services.stop, services.expand}, plan.graph);
  for (const std::string& w : plan.effective.warnings) context.warn(w);
  if (beauty) {
    GOBO_TRY(planBeauty(context, services.techniques));
    if (!context.scene()->lights.empty()) reportMissing(context, plan.missing);
  }
  OutputContext outputs(context, base, services);
  for (const std::string& o : request.outputs()) {
    GOBO_ASSIGN(const OutputPlane plane, infoOf(o).plan(outputs, o, std::string(outputLight(o))));
    GOBO_TRY(plan.graph.wiring());
    if (!plan.graph.at(plane.node).shape.find(plane.plane)) return internalError("a node without the plane " + plane.plane, "output " + o);
    std::vector<std::string> channels = infoOf(o).channelNames();
    if (plan.graph.at(plane.node).shape.find(plane.plane)->channels == 4 && channels.size() == 3) channels.push_back("A");
    plan.outputs.push_back({o, plane.node, plane.plane, std::move(channels)});
  }
  if (services.stop.stopRequested()) return Status(Code::Cancelled, "stopped");

  for (NodeId i = 0; i < plan.graph.size(); ++i) plan.extendable = plan.extendable || plan.graph.at(i).node->traits().extendable;
  plan.missing.insert(plan.missing.begin(), context.missing().begin(), context.missing().end());
  plan.warnings = context.warnings();
  plan.expanded = context.expanded();
  return context.reserved();
}

}  // namespace

Result<std::unique_ptr<Plan>> makePlan(const ScenePtr& base, const v1::RenderRequest& request, uint32_t passes, const PlannerServices& services) {
  auto plan = std::make_unique<Plan>();
  GOBO_ASSIGN(plan->effective, makeEffectiveScene(base, request, services.loadEnvironment, services.poseScene, services.stop));
  GOBO_TRY(checkOutputs(*plan->effective.scene, request));
  plan->groups = makeGroups(*plan->effective.scene, int(request.integrator().max_groups()), services.stop);
  if (services.stop.stopRequested()) return Status(Code::Cancelled, "stopped");
  scaleClusters(plan->effective, plan->groups);

  GOBO_ASSIGN(const PixelWindow window, windowOf(request));
  GOBO_ASSIGN(uint64_t reserved, planNodes(*plan, base, request, passes, window, services));
  std::vector<NodeId> kept;
  for (const PlannedOutput& o : plan->outputs) kept.push_back(o.node);
  int halo = 0;
  if (window.width) { GOBO_ASSIGN(halo, haloOf(plan->graph, kept, {window.width, window.height, 1})); }
  if (halo > 0) {  // again, with what its filters look at around it
    const PixelWindow around = grown(window, halo, int(request.width()), int(request.height()));
    plan->graph = Graph();
    plan->outputs.clear();
    plan->missing.clear();
    const bool all = around.width == int(request.width()) && around.height == int(request.height());  // shares its terms
    GOBO_ASSIGN(reserved, planNodes(*plan, base, request, passes, all ? PixelWindow{} : around, services));
    kept.clear();
    const std::vector<bool> ofView = nodesOfView(plan->graph, {around.width, around.height, 1});
    for (PlannedOutput& o : plan->outputs) {
      if (ofView[size_t(o.node)])
        o.node = plan->graph.add({makeCropNode({around.width, around.height, 1}, window.x - around.x, window.y - around.y, window.width, window.height),
                                  {o.node},
                                  {},
                                  "crop:" + o.name});
      kept.push_back(o.node);
    }
    GOBO_TRY(plan->graph.wiring());
  }
  plan->pinnedBytes = mostLiveBytes(plan->graph, kept, plan->expanded) + reserved;
  return plan;
}

}  // namespace gobo

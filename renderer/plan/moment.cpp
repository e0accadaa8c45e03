// SPDX-License-Identifier: Apache-2.0
#include "plan/moment.h"

#include "plan/cryptomatte.h"
#include "plan/denoised.h"
#include "plan/denoised_slices.h"
#include "plan/filtered_light.h"
#include "plan/output_plans.h"
#include "request/shutter.h"
#include "technique/plan_context.h"
#include "trace/reach.h"

namespace gobo {
inline namespace plan {

namespace {

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

}  // namespace

Result<Moment> momentOf(const ScenePtr& base, const v1::RenderRequest& request, uint32_t k, const Sky& before, const PlannerServices& services) {
  Moment m;
  if (hasShutter(request)) {
    GOBO_ASSIGN(m.request, sliceRequest(request, k));
  } else m.request = request;
  m.share = {k, shutterSlices(request)};
  m.sharedSeed = request.seed();
  m.lens = mayHaveLens(request);
  m.sky.settings = m.request.environment().sky().SerializeAsString();
  EnvironmentPtr known = before.settings == m.sky.settings ? before.map : nullptr;
  const bool remembers = services.lastSky && m.request.environment().has_sky();
  if (!known && remembers) known = services.lastSky->find(m.sky.settings);
  GOBO_ASSIGN(m.effective, makeEffectiveScene(base, m.request, services.loadEnvironment, services.poseScene, services.stop, known));
  m.sky.map = m.effective.sky;
  if (remembers) services.lastSky->keep(m.sky.settings, m.sky.map);
  GOBO_TRY(checkOutputs(*m.effective.scene, m.request));
  m.groups = makeGroups(*m.effective.scene, int(m.request.integrator().max_groups()), services.stop);
  if (services.stop.stopRequested()) return Status(Code::Cancelled, "stopped");
  scaleClusters(m.effective, m.groups);
  return m;
}

Result<uint64_t> planMoment(Plan& plan, std::vector<PlannedOutput>& planned, std::vector<OutputPlane>& planes, const ScenePtr& base, const Moment& moment,
                            uint32_t passes, const PixelWindow& window, const PlannerServices& services) {
  const v1::RenderRequest& request = moment.request;
  Distinctions apart;
  bool beauty = false;
  const bool bends = needsCurvature(request, size_t(moment.groups.count)) && !(moment.share.of > 1 && filtersMeanOfSlices(request));
  for (const std::string& o : request.outputs()) {
    apart.classes = apart.classes || needsClasses(infoOf(o)) || (request.has_denoise() && needsRadiance(infoOf(o)));
    apart.lobes = apart.lobes || needsLobes(infoOf(o));
    apart.variance = apart.variance || o == "variance";
    apart.curvature = apart.curvature || (bends && needsRadiance(infoOf(o)));
    apart.seen = std::max(apart.seen, infoOf(o).seen);
    beauty = beauty || needsRadiance(infoOf(o));
  }
  const FilterDistinctions filters = filterDistinctions(request);
  apart.classes = apart.classes || (beauty && filters.classes);
  apart.lobes = apart.lobes || (beauty && filters.lobes);
  PlanContext context(
      {request, moment.effective, moment.groups, passes, window, apart, services.stop, services.expand, moment.share, moment.sharedSeed, moment.lens},
      plan.graph);
  for (const std::string& w : moment.effective.warnings) context.warn(w);
  std::vector<std::string> missing;
  GOBO_TRY(checkFilters(context));
  pruneIdentities(plan.graph, request);
  if (anyFilter(request) && request.has_certificate())
    context.warn("request.certificate: compares the picture as request.filters leave it with light that no filter has seen: what they do counts as error");
  if (anyFilter(request) && apart.variance) context.warn("variance: of the light before request.filters");
  if (beauty) {
    GOBO_TRY(planBeauty(context, services.techniques));
    if (!context.scene()->lights.empty()) reportMissing(context, missing);
  }
  OutputContext outputs(context, base, services);
  for (const std::string& o : request.outputs()) {
    GOBO_ASSIGN(const OutputPlane plane, infoOf(o).plan(outputs, o, std::string(outputLight(o))));
    GOBO_TRY(plan.graph.wiring());
    if (!plan.graph.at(plane.node).shape.find(plane.plane)) return internalError("a node without the plane " + plane.plane, "output " + o);
    std::vector<std::string> channels = infoOf(o).channelNames();
    if (plan.graph.at(plane.node).shape.find(plane.plane)->channels == 4 && channels.size() == 3) channels.push_back("A");
    planned.push_back({o, plane.node, plane.plane, std::move(channels)});
    planes.push_back(plane);
    plan.mattesGrow = plan.mattesGrow || (infoOf(o).kind == OutputKind::Matte && cryptomatteTakesMore(passes, moment.share.of));
  }
  if (services.stop.stopRequested()) return Status(Code::Cancelled, "stopped");

  missing.insert(missing.begin(), context.missing().begin(), context.missing().end());
  addNew(plan.missing, missing);
  addNew(plan.warnings, context.warnings());
  addNew(plan.expanded, context.expanded());
  return context.reserved();
}

}  // namespace plan
}  // namespace gobo

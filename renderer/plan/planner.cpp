// SPDX-License-Identifier: Apache-2.0
#include "plan/planner.h"

#include <algorithm>
#include <optional>

#include "filters/crop.h"
#include "filters/slice_sum.h"
#include "filters/with_alpha.h"
#include "plan/denoised_slices.h"
#include "plan/filtered_light.h"
#include "plan/live_bytes.h"
#include "plan/output_plans.h"
#include "plan/outputs.h"
#include "plan/window.h"
#include "request/shutter.h"
#include "technique/plan_context.h"
#include "trace/reach.h"

namespace gobo::inline plan {

namespace {

const OutputInfo& infoOf(const std::string& output) { return *findOutput(output); }

/// What a shutter's slices of an output are together.
SlicePlane::How togetherOf(const std::string& output) {
  if (output == "sample_count") return SlicePlane::How::Sum;
  return infoOf(output).kind == OutputKind::Matte ? SlicePlane::How::Ranked : SlicePlane::How::Mean;
}

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

/// Moment k of a shutter's, or the only one there is. `before`: another one, or none.
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

template <typename T>
void addNew(std::vector<T>& to, const std::vector<T>& from) {
  for (const T& t : from)
    if (std::find(to.begin(), to.end(), t) == to.end()) to.push_back(t);
}

/// Nodes and outputs of a window of the picture of a moment; of no width: all of it. Bytes that may be held beside what the nodes say. `planes`: of the same
/// outputs, in their order.
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
  }
  if (services.stop.stopRequested()) return Status(Code::Cancelled, "stopped");

  missing.insert(missing.begin(), context.missing().begin(), context.missing().end());
  addNew(plan.missing, missing);
  addNew(plan.warnings, context.warnings());
  addNew(plan.expanded, context.expanded());
  return context.reserved();
}

/// Poses of a shutter's slices are made before anything is admitted, and are there at once.
constexpr uint64_t kMostPoseBytes = 1ull << 30;

/// Of what a pose does not share with the loaded scene: its lists, and mesh arrays that are others. (Meshes of a variant share theirs.)
uint64_t bytesOfPose(const Scene& posed, const Scene& base) {
  if (&posed == &base) return 0;
  uint64_t bytes = posed.instances.size() * sizeof(Instance) + posed.lights.size() * sizeof(Light) + posed.materials.size() * sizeof(Material);
  const auto add = [&](const auto& array, const auto& rest) {
    if (array.data() != rest.data()) bytes += array.size() * sizeof(array[0]);
  };
  static const Mesh none;
  for (size_t i = 0; i < posed.meshes.size(); ++i) {  // an edit of an object may add one
    const Mesh &m = *posed.meshes[i], &rest = i < base.meshes.size() ? *base.meshes[i] : none;
    if (&m == &rest) continue;
    add(m.indices, rest.indices);
    add(m.positions, rest.positions);
    add(m.normals, rest.normals);
    add(m.tangents, rest.tangents);
    add(m.colours, rest.colours);
    for (size_t u = 0; u < std::size(m.uv); ++u) add(m.uv[u], rest.uv[u]);
  }
  return bytes;
}

/// Each slice of the shutter's interval as the picture of its moment, and what they are together.
Result<uint64_t> planSlices(Plan& plan, const ScenePtr& base, const v1::RenderRequest& request, uint32_t passes, const PixelWindow& window,
                            const PlannerServices& services) {
  const uint32_t slices = shutterSlices(request);
  std::vector<NodeId> pictures;
  std::vector<SlicePlane> planes;
  std::vector<OutputPlane> middle;  // outputs of one slice
  std::vector<size_t> first;        // of each output's planes
  std::vector<NoisyPlanes> noisy;   // of those that are filtered
  std::vector<bool> lit;            // whether filters have something to do in any slice
  uint64_t reserved = 0, poses = 0;
  Sky sky;
  for (uint32_t k = 0; k < slices; ++k) {
    GOBO_ASSIGN(Moment moment, momentOf(base, request, k, sky, services));
    sky = moment.sky;
    poses += bytesOfPose(*moment.effective.scene, *base);  // the graph has all of them
    if (const uint64_t all = poses / (k + 1) * slices; all > kMostPoseBytes)
      return Status(Code::ResourceExhausted,
                    "request.camera.shutter_slices = " + std::to_string(slices) + ": that many poses of the scene are " + std::to_string(all >> 20) +
                        " MiB; must be at most " + std::to_string(kMostPoseBytes >> 20),
                    "request.camera.shutter_slices");
    const NodeId begin = plan.graph.size();
    std::vector<PlannedOutput> planned;
    std::vector<OutputPlane> outputs;
    GOBO_ASSIGN(const uint64_t held, planMoment(plan, planned, outputs, base, moment, passes, window, services));
    plan.graph.addToLabels(begin, ":slice " + std::to_string(k + 1));
    reserved = std::max(reserved, held);
    lit.resize(outputs.size());
    bool seen = false;  // features are shared
    for (size_t i = 0; i < outputs.size(); ++i) {
      const OutputPlane& o = outputs[i];
      if (k == 0) first.push_back(planes.size());
      if (o.noisy) {
        lit[i] = lit[i] || o.noisy->lit;
        if (k == 0) noisy.push_back(slicedPlanes(*o.noisy, planes, noisy.empty() ? nullptr : &noisy[0]));
        addNoisySlice(*o.noisy, pictures, seen);
        seen = true;
        if (o.clear >= 0) pictures.push_back(o.clear);
        if (o.clear >= 0 && k == 0) planes.push_back({"s0", 3});
        continue;
      }
      if (o.clear >= 0) {  // to be filtered before it gets its alpha
        pictures.insert(pictures.end(), {o.node, o.clear});
        if (k == 0) planes.insert(planes.end(), {{o.plane, 3}, {"s0", 3}});
        continue;
      }
      pictures.push_back(o.node);
      if (k == 0) planes.push_back({o.plane, plan.graph.at(o.node).shape.find(o.plane)->channels, togetherOf(planned[i].name)});
    }
    if (k == slices / 2) {
      middle = std::move(outputs);
      plan.effective = std::move(moment.effective);
      plan.groups = std::move(moment.groups);
      plan.outputs = std::move(planned);
    }
  }
  const int width = window.width ? window.width : int(request.width()), height = window.width ? window.height : int(request.height());
  const size_t all = planes.size();
  size_t filtered = 0;
  const NodeId sum = plan.graph.add({makeSliceSumNode(std::move(planes), width, height, int(slices)), std::move(pictures), {}, "shutter"});
  GOBO_TRY(plan.graph.wiring());
  for (size_t i = 0; i < plan.outputs.size(); ++i) {
    PlannedOutput& o = plan.outputs[i];
    o.node = sum;
    o.plane = slicedPlane(first[i]);
    const Chain chain = o.name == "beauty" ? chainOf(request, o.name) : Chain{};
    if (middle[i].noisy) {
      GOBO_ASSIGN(o.node, planDenoisedSlices(plan.graph, request, sum, noisy[filtered++], *middle[i].noisy, lit[i], int(slices), width, height, o.name));
    } else if (!chain.empty()) {
      o.node = plan.graph.add({makeSlicePartNode("picture", {{"rgb", 3}}, first[i], width, height), {sum}, {}, o.name});
    } else continue;
    o.plane = "rgb";
    o.node = addChain(plan.graph, o.node, chain, pictureShape(width, height), o.name);
    if (middle[i].clear < 0) continue;
    const size_t last = (i + 1 < first.size() ? first[i + 1] : all) - 1;
    const NodeId clear = plan.graph.add({makeSlicePartNode("radiance", {{"s0", 3}}, last, width, height), {sum}, {}, o.name + " background"});
    o.node = plan.graph.add({makeWithAlphaNode(width, height), {o.node, clear}, {}, o.name + " with alpha"});
    o.plane = "rgba";
    o.channels.push_back("A");
  }
  GOBO_TRY(plan.graph.wiring());
  return reserved + poses;
}

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

EnvironmentPtr LastSky::find(const std::string& settings) const {
  std::lock_guard lock(mutex_);
  return map_ && settings_ == settings ? map_ : nullptr;
}

void LastSky::keep(const std::string& settings, EnvironmentPtr map) {
  std::lock_guard lock(mutex_);
  settings_ = settings;
  map_ = std::move(map);
}

uint64_t LastSky::bytes() const {
  std::lock_guard lock(mutex_);
  return map_ ? map_->texels.size() * sizeof(Vec3) : 0;
}

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

}  // namespace gobo::inline plan

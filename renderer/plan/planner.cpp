// SPDX-License-Identifier: Apache-2.0
#include "plan/planner.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <map>
#include <span>

#include "filters/ambient_light.h"
#include "filters/automatic/automatic.h"
#include "filters/composite.h"
#include "filters/sample_statistics.h"
#include "filters/shadow_map/techniques.h"
#include "filters/shadow_technique.h"
#include "filters/tinted_visibility.h"
#include "plan/caustic_plan.h"
#include "plan/material_kinds.h"
#include "plan/outputs.h"
#include "terms/area_light_list.h"
#include "terms/caustics.h"
#include "terms/direct_unoccluded.h"
#include "terms/extract_lights.h"
#include "terms/gbuffer.h"
#include "terms/ids.h"
#include "terms/motion.h"
#include "terms/path_trace.h"
#include "terms/surface.h"
#include "trace/camera_media.h"
#include "trace/reach.h"

namespace gobo {

namespace {

constexpr int kUnoccludedSamples = 32, kSquareSamples = 8;   // the latter for each of many lights at infinity
constexpr size_t kKeptEnvironmentBytes = size_t(256) << 20;  // terms of lights in the map's place, beyond which they are made again

/// One weighted plane of the beauty and what it holds.
struct Contribution {
  NodeId node;
  std::string plane;
  Vec3 weight;
  PathClass pathClass;
  int group;  ///< relight group; -1: none (unlit surfaces)
  LobePart lobe = LobePart::Both;
  NodeId state = -1;  ///< path tracing state that it is the mean of, and the slot there; -1: by a visibility technique
  int slot = 0;
};

class PlanMaker {
 public:
  PlanMaker(const ScenePtr& base, const v1::RenderRequest& request, uint32_t blocks, uint32_t blockSize, const PlannerServices& services, Plan& plan)
      : base_(base),
        request_(request),
        blocks_(blocks),
        blockSize_(blockSize),
        services_(services),
        plan_(plan),
        scene_(plan.effective.scene),
        width_(int(request.width())),
        height_(int(request.height())),
        viewSamples_(int(request.view_samples())) {
    view_.camera = plan.effective.camera;
    view_.width = width_;
    view_.height = height_;
    view_.viewSamples = viewSamples_;
    kinds_ = materialKinds(*scene_);
  }

  Status make() {
    bool radiance = false;
    for (const std::string& o : request_.outputs()) {
      splitClasses_ = splitClasses_ || o == "direct" || o == "indirect" || o == "emission";
      splitLobes_ = splitLobes_ || needsLobes(o);
      variance_ = variance_ || o == "variance";
      radiance = radiance || needsRadiance(o);
    }
    if (radiance) GOBO_TRY(planRadiance());
    for (const std::string& o : request_.outputs()) GOBO_TRY(planOutput(o));
    for (NodeId i = 0; i < plan_.graph.size(); ++i) {
      const GraphNode& n = plan_.graph.at(i);
      plan_.extendable = plan_.extendable || n.node->traits().extendable;
      if (!n.transient) plan_.pinnedBytes += n.node->outputBytes();
    }
    return {};
  }

 private:
  // ---- view terms -------------------------------------------------------------------------------------------------
  NodeId source(NodePtr node, std::vector<NodeId> inputs, std::vector<int> lights, std::string label, const ScenePtr& scene, bool transient = false) {
    GraphNode n{std::move(node), std::move(inputs), std::move(lights), std::move(label), 0, scene, transient};
    return plan_.graph.add(std::move(n));
  }
  NodeId filter(NodePtr node, std::vector<NodeId> inputs, std::string label) {
    return plan_.graph.add({std::move(node), std::move(inputs), {}, std::move(label)});
  }
  NodeId gbuffer() { return source(makeGBufferNode(view_), {}, {}, "gbuffer", scene_); }
  NodeId surface() { return source(makeSurfaceNode(view_), {gbuffer()}, {}, "surface", scene_); }

  // ---- techniques -------------------------------------------------------------------------------------------------
  v1::ShadowTechnique techniqueOf(int light, const ScenePtr& scene, const std::string& name) {
    v1::ShadowTechnique t = request_.shadows();
    const auto edit = request_.lights().find(name);
    if (edit != request_.lights().end() && edit->second.has_shadow()) t = edit->second.shadow();
    const LightKind kind = scene->lights[light].shape.kind;
    const ShadowTechniqueEntry* entry = findShadowTechnique(t.technique_case());
    if (entry && kind == LightKind::Environment) {
      t.mutable_path_traced();
      return t;
    }
    if (entry && cameraInVolume()) {
      warn("the camera is inside a volume: direct light is path traced");
      t.mutable_path_traced();
      return t;
    }
    if (entry && !entry->supports(kind)) {
      warn(std::string(entry->name) + " does not do the kind of light '" + name + "': ray_traced used");
      t.mutable_ray_traced();
      (void)resolveRayTraced(t);
    }
    return t;
  }
  /// Techniques know no absorption between the camera and the first surface.
  bool cameraInVolume() {
    if (!kinds_.volumes) return false;
    if (cameraInVolume_ < 0) {
      const std::vector<int> none;
      cameraInVolume_ =
          volumesAround(SceneView(*scene_, Facet::Topology | Facet::Pose | Facet::Bsdf, none), cameraPoint(view_.camera), services_.stop).empty() ? 0 : 1;
    }
    return cameraInVolume_ > 0;
  }
  static Status resolveRayTraced(v1::ShadowTechnique& t) {
    if (!t.ray_traced().has_samples()) t.mutable_ray_traced()->set_samples(16);
    return {};
  }
  void warn(const std::string& text) {
    if (std::find(plan_.warnings.begin(), plan_.warnings.end(), text) == plan_.warnings.end()) plan_.warnings.push_back(text);
  }
  Result<NodeId> visibility(int light, const ScenePtr& scene, const v1::ShadowTechnique& t) {
    ShadowInput in;
    in.scene = scene;
    in.light = light;
    in.gbuffer = gbuffer();
    in.camera = view_.camera;
    in.width = width_;
    in.height = height_;
    in.viewSamples = viewSamples_;
    in.seed = request_.seed();
    in.clear = kinds_.clear;
    const ShadowTechniqueEntry* entry = findShadowTechnique(t.technique_case());
    GOBO_CHECK(entry != nullptr);
    if (t.has_auto_()) return automatic(in, t);
    return planned(*entry, in, t);
  }
  Result<NodeId> planned(const ShadowTechniqueEntry& entry, const ShadowInput& in, const v1::ShadowTechnique& t) {
    GOBO_ASSIGN(const NodeId v, entry.plan(plan_.graph, in, t));
    return entry.usesMap ? planTint(plan_.graph, in, v) : v;
  }
  /// shadows.auto: the choice goes into the plan, each rejected candidate as a pruned row with what it would have cost.
  Result<NodeId> automatic(const ShadowInput& in, const v1::ShadowTechnique& t) {
    GOBO_ASSIGN(const AutomaticChoice choice, chooseShadow(plan_.graph, in, t, services_.expand));
    const std::string& name = in.scene->lights[size_t(in.light)].name;
    const AutomaticCandidate& chosen = choice.candidates[choice.chosen];
    for (size_t k = 0; k < choice.candidates.size(); ++k) {
      const AutomaticCandidate& c = choice.candidates[k];
      char text[160];
      if (c.judged)
        std::snprintf(text, sizeof text, "%s: expected error %.4f in %.1f ms", k == choice.chosen ? "auto chose it" : "auto passed it over", c.rmse, c.ms);
      else std::snprintf(text, sizeof text, "auto passed it over: %.1f ms", c.ms);
      if (choice.receivers > 0 || k == choice.chosen) plan_.graph.prune("auto:" + name + ": " + c.text, text);
    }
    const ShadowTechniqueEntry* entry = findShadowTechnique(chosen.technique.technique_case());
    GOBO_CHECK(entry != nullptr);
    return planned(*entry, in, chosen.technique);
  }
  /// One of the lights that stand for an environment's map and have some size.
  static bool isSquare(const LightShape& s) { return s.kind == LightKind::Directional && s.skyRectangle != Vec2(0.0f); }
  /// The parts that direct light is planned in.
  std::vector<LobePart> lobes() const { return splitLobes_ ? std::vector{LobePart::Diffuse, LobePart::Specular} : std::vector{LobePart::Both}; }
  static std::string withLobe(std::string label, LobePart lobe) {
    return lobe == LobePart::Both ? label : label + (lobe == LobePart::Diffuse ? ":diffuse" : ":specular");
  }
  NodeId unoccluded(int light, const ScenePtr& scene, const Vec3& nominal, bool transient = false, LobePart lobe = LobePart::Both) {
    DirectUnoccludedSettings s;
    s.lobe = lobe;
    s.view = view_;
    s.light = light;
    s.nominal = nominal;
    const LightShape& shape = scene->lights[light].shape;
    const bool delta = isDeltaLight(shape);  // evaluated, not sampled: seed and count are no part of its key
    s.samples = isSquare(shape) ? kSquareSamples : delta ? 1 : kUnoccludedSamples;
    s.seed = delta ? 0 : request_.seed();
    s.extended = kinds_.extended;
    return source(makeDirectUnoccludedNode(s), {gbuffer(), surface()}, {light}, withLobe("unoccluded:" + scene->lights[light].name, lobe), scene, transient);
  }

  // ---- radiance ---------------------------------------------------------------------------------------------------
  void add(NodeId node, std::string plane, const Vec3& weight, PathClass c, int group, LobePart lobe = LobePart::Both, NodeId state = -1, int slot = 0) {
    if (state >= 0 && std::find(states_.begin(), states_.end(), state) == states_.end()) states_.push_back(state);
    if (weight == Vec3(0.0f)) return;
    contributions_.push_back({node, std::move(plane), weight, c, group, lobe, state, slot});
  }
  Vec3 groupGain(int group) const {
    const auto& members = plan_.groups.members[group];
    return members.size() == 1 ? plan_.effective.gains[members[0]] : Vec3(1.0f);
  }
  std::string groupName(int group) const {
    const auto& members = plan_.groups.members[group];
    return members.size() == 1 ? scene_->lights[members[0]].name : "cluster of " + std::to_string(members.size());
  }

  PathTracerSettings tracerSettings(PathClass cover) const {
    PathTracerSettings s;
    const v1::Integrator& i = request_.integrator();
    s.camera = view_.camera;
    s.width = width_;
    s.height = height_;
    s.blockSize = int(blockSize_);
    s.viewSamples = i.at_view_samples() ? viewSamples_ : 0;
    s.maxBounces = has(cover, PathClass::Indirect) ? int(i.max_bounces()) : 0;
    s.rouletteStart = int(i.russian_roulette_start());
    s.seed = request_.seed();
    s.cover = cover;
    return s;
  }

  /// A path tracing node over `lights` with one slot group per entry of `groups` (relight group ids, ascending).
  void pathTrace(const std::vector<int>& lights, PathClass cover, const std::string& label, const std::vector<Vec3>& nominal, const std::vector<int>& slotGroup,
                 const std::vector<int>& groups, const std::vector<Vec3>& weights, bool behindOnly = false, bool unlit = false) {
    PathTracerSettings s = tracerSettings(cover);
    s.behindOnly = behindOnly;
    s.unlit = unlit;
    const int classes = has(cover, PathClass::Emission) + has(cover, PathClass::Direct) + has(cover, PathClass::Indirect);
    const bool scatters = has(cover, PathClass::Direct) || has(cover, PathClass::Indirect);
    s.split = splitLobes_ && scatters ? SplitMode::ByLobe : (splitClasses_ || splitLobes_) && classes > 1 ? SplitMode::DirectIndirect : SplitMode::Combined;
    s.selection = request_.integrator().light_selection() == v1::Integrator::UNIFORM ? LightSelection::Uniform
                  : request_.integrator().light_selection() == v1::Integrator::POWER ? LightSelection::Power
                                                                                     : LightSelection::Tree;
    s.groups = int(groups.size());
    s.groupOf = slotGroup;
    s.nominal = nominal;
    GraphNode n{makePathTraceNode(s, variance_ ? kVarianceStreams : 1), {}, lights, label, blocks_, scene_};
    const NodeId state = plan_.graph.add(std::move(n));
    const int per = slotsPerGroup(s.split, s.maxBounces);
    const NodeId mean = filter(makeResolveNode(width_, height_, per * s.groups), {state}, label + ":mean");
    for (size_t g = 0; g < groups.size(); ++g) {
      for (int k = 0; k < per; ++k) {
        const bool byLobe = s.split == SplitMode::ByLobe;
        const PathClass c = per == 1 ? cover : k == 0 ? PathClass::Emission : k <= (byLobe ? 2 : 1) ? PathClass::Direct : PathClass::Indirect;
        if (per > 1 && !has(cover, c)) continue;
        const LobePart lobe = !byLobe || k == 0 ? LobePart::Both : k % 2 ? LobePart::Diffuse : LobePart::Specular;
        const int slot = int(g) * per + k;
        add(mean, "s" + std::to_string(slot), weights[g], c, groups[g], lobe, state, slot);
      }
    }
  }

  /// The same for whole relight groups restricted to `lights`.
  void pathTraceGroups(const std::vector<int>& lights, PathClass cover, const std::string& label, bool behindOnly = false) {
    std::vector<int> groups, slotGroup;
    std::vector<Vec3> nominal, weights;
    for (int l : lights) {
      const int g = plan_.groups.groupOf[l];
      if (std::find(groups.begin(), groups.end(), g) == groups.end()) groups.push_back(g);
    }
    std::sort(groups.begin(), groups.end());
    for (int l : lights) {
      slotGroup.push_back(int(std::find(groups.begin(), groups.end(), plan_.groups.groupOf[l]) - groups.begin()));
      nominal.push_back(plan_.groups.nominal[l]);
    }
    for (int g : groups) weights.push_back(groupGain(g));
    pathTrace(lights, cover, label, nominal, slotGroup, groups, weights, behindOnly);
    for (int l : lights) cover_[plan_.groups.groupOf[l]] = cover_[plan_.groups.groupOf[l]] | cover;
  }

  Status planRadiance() {
    const auto& lights = scene_->lights;
    const int n = int(lights.size());
    const bool indirect = request_.integrator().indirect() && request_.integrator().max_bounces() > 0;
    // Unlit surfaces belong to no light: a group of their own, that no gain touches.
    if (kinds_.unlit)
      pathTrace({}, indirect ? PathClass::Emission | PathClass::Indirect : PathClass::Emission, "unlit", {}, {}, {-1}, {Vec3(1.0f)}, false, true);
    if (n == 0) {
      if (!kinds_.unlit) plan_.graph.prune("beauty", "the scene has no light");
      return {};
    }
    cover_.assign(plan_.groups.count, PathClass::None);
    if (!indirect) plan_.graph.prune("indirect", request_.integrator().indirect() ? "max_bounces is 0" : "integrator.indirect is false", true);
    const v1::EnvironmentSettings& sky = request_.environment();
    if (sky.area_lights() > 0 && sky.extract_lights() > 0)
      return invalidArgument("request.environment.area_lights: " + std::to_string(sky.area_lights()) + " and extract_lights " +
                                 std::to_string(sky.extract_lights()) + " both stand for the map: ask for one",
                             "request.environment.area_lights");
    const bool extract = (sky.area_lights() > 0 || sky.extract_lights() > 0) && scene_->environment != nullptr;

    std::vector<int> all, traced, viewed, visible;  // viewed: direct by a visibility technique; visible: emission by a separate node
    std::vector<v1::ShadowTechnique> technique(n);
    for (int l = 0; l < n; ++l) {
      all.push_back(l);
      technique[l] = techniqueOf(l, scene_, lights[l].name);
      const bool environmentByLights = extract && lights[l].shape.kind == LightKind::Environment;
      if (!findShadowTechnique(technique[l].technique_case()) && !environmentByLights) {
        traced.push_back(l);
        continue;
      }
      if (!environmentByLights) viewed.push_back(l);
      if (rayReaches(lights[l].shape, lights[l].cameraVisible, Receiver::Camera, Passage::Open)) visible.push_back(l);
    }
    if (int(traced.size()) == n) {
      pathTraceGroups(all, indirect ? PathClass::All : PathClass::Emission | PathClass::Direct, "path_trace");
    } else {
      if (indirect) pathTraceGroups(all, PathClass::Indirect, "indirect");
      if (!traced.empty()) pathTraceGroups(traced, PathClass::Emission | PathClass::Direct, "direct");
      if (!visible.empty()) pathTraceGroups(visible, PathClass::Emission, "emission");
      GOBO_TRY(planViewedDirect(viewed, technique));
      // Techniques see the front of surfaces; direct light through them is traced.
      if (kinds_.translucent && !viewed.empty()) pathTraceGroups(viewed, PathClass::Direct, "through", true);
      if (extract) GOBO_TRY(planEnvironmentLights());
    }
    planClusterEdits(indirect);
    planCaustics();
    reportCover();
    return {};
  }

  Status planViewedDirect(const std::vector<int>& viewed, const std::vector<v1::ShadowTechnique>& technique) {
    std::map<std::pair<int, LobePart>, std::vector<NodeId>> folds;  // cluster group -> pairs (L, V)
    if (!viewed.empty()) surface();                                 // made (and kept) before any node that is marked transient below
    for (int l : viewed) {
      const int group = plan_.groups.groupOf[l];
      const bool single = plan_.groups.single(group);
      const std::string& name = scene_->lights[l].name;
      if (single && groupGain(group) == Vec3(0.0f)) {
        plan_.graph.prune("direct:" + name, "its gain is zero");
        cover_[group] = cover_[group] | PathClass::Direct;
        continue;
      }
      const int before = plan_.graph.size();
      std::vector<NodeId> parts;
      for (const LobePart lobe : lobes()) parts.push_back(unoccluded(l, scene_, plan_.groups.nominal[l], !single, lobe));
      GOBO_ASSIGN(const NodeId v, visibility(l, scene_, technique[l]));
      if (!single) plan_.graph.markTransient(before, v);
      for (size_t k = 0; k < parts.size(); ++k) {
        const LobePart lobe = lobes()[k];
        if (single) {
          add(filter(makeShadeNode(width_, height_, viewSamples_), {parts[k], v}, withLobe("direct:" + name, lobe)), "rgb", groupGain(group), PathClass::Direct,
              group, lobe);
        } else {
          folds[{group, lobe}].push_back(parts[k]);
          folds[{group, lobe}].push_back(v);
        }
      }
      cover_[group] = cover_[group] | PathClass::Direct;
    }
    for (auto& [key, pairs] : folds) {
      const auto [group, lobe] = key;
      const int count = int(pairs.size() / 2);
      add(filter(makeDirectFoldNode(width_, height_, viewSamples_, count), std::move(pairs), withLobe("direct:" + groupName(group), lobe)), "rgb",
          groupGain(group), PathClass::Direct, group, lobe);
    }
    return {};
  }

  /// Lights at infinity that stand for the map: directional ones, or squares of some size with what they leave over.
  struct EnvironmentLights {
    std::vector<Light> lights;
    std::array<Vec3, 9> ambient{};
    std::string kind;
  };
  Result<EnvironmentLights> environmentLights() {
    const bool squares = request_.environment().area_lights() > 0;
    const NodePtr node =
        squares ? makeAreaLightListNode(int(request_.environment().area_lights())) : makeExtractLightsNode(int(request_.environment().extract_lights()));
    GOBO_ASSIGN(const TermPtr term, services_.expand(plan_.graph, source(node, {}, {}, squares ? "area_lights" : "extract_lights", scene_)));
    const float r = scene_->environment->rotation, cosR = std::cos(r), sinR = std::sin(r);
    const auto toWorld = [&](std::span<const float> d, int i) {
      return Vec3(d[3 * i] * cosR + d[3 * i + 2] * sinR, d[3 * i + 1], d[3 * i + 2] * cosR - d[3 * i] * sinR);
    };
    const auto directions = term->floats("direction"), irradiance = term->floats("irradiance");
    EnvironmentLights out;
    out.kind = squares ? "area lights" : "extracted lights";
    const int count = squares ? int(term->plane<uint32_t>("count")[0]) : term->extent().width;
    for (int i = 0; i < count; ++i) {
      Light light;
      light.name = "environment/" + std::to_string(i);
      light.shape.kind = LightKind::Directional;
      light.shape.axis = -toWorld(directions, i);
      if (squares) {
        light.shape.u = toWorld(term->floats("right"), i);
        light.shape.skyRectangle = Vec2(term->floats("angularSize")[2 * i], term->floats("angularSize")[2 * i + 1]);
      }
      light.power = Vec3(irradiance[3 * i], irradiance[3 * i + 1], irradiance[3 * i + 2]);
      out.lights.push_back(light);
    }
    if (squares)
      for (int i = 0; i < 9; ++i)
        for (int k = 0; k < 3; ++k) out.ambient[i][k] = term->floats("remainder")[3 * i + k];
    return out;
  }

  Status planEnvironmentLights() {
    int environment = -1;
    for (size_t l = 0; l < scene_->lights.size(); ++l)
      if (scene_->lights[l].shape.kind == LightKind::Environment) environment = int(l);
    if (environment < 0) return {};
    const int group = plan_.groups.groupOf[environment];
    GOBO_ASSIGN(const EnvironmentLights found, environmentLights());
    auto extended = std::make_shared<Scene>(*scene_);
    const int first = int(extended->lights.size()), count = int(found.lights.size());
    extended->lights.insert(extended->lights.end(), found.lights.begin(), found.lights.end());
    GOBO_TRY(extended->seal());
    const Vec3 nominal = plan_.groups.nominal[environment];  // scale of the map that gains refer to
    plan_.graph.prune("direct:environment map", "replaced by " + std::to_string(count) + " " + found.kind, true);
    if (count > 0) GOBO_TRY(planEnvironmentFolds(extended, first, found, nominal, group));
    if (found.ambient != std::array<Vec3, 9>{}) {
      AmbientLightSettings s{found.ambient, scene_->environment->rotation, width_, height_, viewSamples_};
      for (Vec3& c : s.radiance) c *= nominal;
      GraphNode n{makeAmbientLightNode(s), {gbuffer(), surface()}, {}, "ambient:environment"};
      n.approximate = "what the area lights leave of the map is not shadowed and reaches the diffuse lobe alone";
      add(plan_.graph.add(std::move(n)), "rgb", groupGain(group), PathClass::Direct, group, splitLobes_ ? LobePart::Diffuse : LobePart::Both);
    }
    cover_[group] = cover_[group] | PathClass::Direct;
    if (kinds_.translucent) pathTraceGroups({environment}, PathClass::Direct, "through:environment", true);
    return {};
  }

  Status planEnvironmentFolds(const ScenePtr& extended, int first, const EnvironmentLights& found, const Vec3& nominal, int group) {
    const int count = int(found.lights.size());
    v1::ShadowTechnique t = techniqueOf(first, extended, "environment");
    if (!findShadowTechnique(t.technique_case())) t.mutable_ray_traced()->set_samples(isSquare(found.lights[0].shape) ? 4 : 1);
    surface();  // made (and kept) before any node that is marked transient below
    const bool keep = size_t(count) * width_ * height_ * viewSamples_ * 16 <= kKeptEnvironmentBytes;
    for (const LobePart lobe : lobes()) {
      std::vector<NodeId> pairs;
      for (int i = 0; i < count; ++i) {
        const int before = plan_.graph.size();
        pairs.push_back(unoccluded(first + i, extended, found.lights[size_t(i)].power * nominal, !keep, lobe));
        GOBO_ASSIGN(const NodeId v, visibility(first + i, extended, t));
        if (!keep) plan_.graph.markTransient(before, v);
        pairs.push_back(v);
      }
      add(filter(makeDirectFoldNode(width_, height_, viewSamples_, count), std::move(pairs), withLobe("direct:environment", lobe)), "rgb", groupGain(group),
          PathClass::Direct, group, lobe);
    }
    return {};
  }

  /// Lights edited inside a cluster: that light is traced alone, white and at its nominal power, and added (new - old) times per
  /// channel, so that it may gain what it had none of. The cluster itself is untouched.
  void planClusterEdits(bool indirect) {
    for (size_t l = 0; l < scene_->lights.size(); ++l) {
      const Vec3 weight = plan_.effective.gainChanges[l];
      const int group = plan_.groups.groupOf[l];
      if (weight == Vec3(0.0f) || plan_.groups.single(group)) continue;
      // A difference of all three classes at once, whatever technique the cluster uses for its own direct light.
      pathTrace({int(l)}, indirect ? PathClass::All : PathClass::Emission | PathClass::Direct, "difference:" + scene_->lights[l].name,
                {Vec3(nominalScalar(scene_->lights[l]))}, {0}, {group}, {weight});
    }
  }

  void planCaustics() {
    const CausticPlan plan = causticPlan(*scene_, kinds_, request_.integrator());
    if (!plan.pruned.empty()) plan_.graph.prune("caustics", plan.pruned, plan.lost);
    for (const CausticTask& t : causticTasks(plan, plan_.effective, plan_.groups, tracerSettings(PathClass::Indirect), splitLobes_)) {
      GraphNode n{makeCausticsNode(t.settings), {}, t.lights, t.label, blocks_, scene_, false, causticNote(plan, blocks_)};
      const NodeId mean = filter(makeResolveNode(width_, height_, t.settings.slots()), {plan_.graph.add(std::move(n))}, t.label + ":mean");
      for (int slot = 0; slot < t.settings.slots(); ++slot) {
        const int g = splitLobes_ ? slot / 2 : slot;
        const LobePart lobe = !splitLobes_ ? LobePart::Both : slot % 2 ? LobePart::Specular : LobePart::Diffuse;
        add(mean, "s" + std::to_string(slot), t.weights[g], PathClass::Indirect, t.groups[g], lobe);
      }
    }
    // A class that is held may still lack paths that nothing finds.
    if (request_.integrator().indirect())
      for (const std::string& lost : classesNotCovered(*scene_, plan.photons > 0)) plan_.missing.push_back(lost);
  }

  void reportCover() {
    for (int g = 0; g < plan_.groups.count; ++g) {
      bool anyVisible = false;
      for (int l : plan_.groups.members[g])
        anyVisible = anyVisible || rayReaches(scene_->lights[l].shape, scene_->lights[l].cameraVisible, Receiver::Camera, Passage::Open);
      if (!has(cover_[g], PathClass::Direct)) plan_.missing.push_back("direct (" + groupName(g) + ")");
      if (anyVisible && !has(cover_[g], PathClass::Emission)) plan_.missing.push_back("emission (" + groupName(g) + ")");
      if (!has(cover_[g], PathClass::Indirect)) plan_.missing.push_back("indirect (" + groupName(g) + ")");
    }
  }

  // ---- outputs ----------------------------------------------------------------------------------------------------
  NodeId compose(const std::string& label, const std::function<bool(const Contribution&)>& wanted) {
    Expression e;
    std::vector<NodeId> inputs;
    int sum = -1;
    for (const Contribution& c : contributions_) {
      if (!wanted(c)) continue;
      auto at = std::find(inputs.begin(), inputs.end(), c.node);
      if (at == inputs.end()) at = inputs.insert(inputs.end(), c.node);
      const int plane = e.plane(int(at - inputs.begin()), c.plane);
      if (sum < 0) sum = e.constant(Vec3(0.0f));
      sum = e.multiplyAdd(sum, c.weight, plane);
    }
    if (sum < 0) e.constant(Vec3(0.0f));
    return filter(makeCompositeNode(std::move(e), width_, height_), std::move(inputs), label);
  }
  NodeId pixelMean(NodeId node, const std::string& plane, int channels, bool overValid, const std::string& label) {
    std::vector<NodeId> inputs{node, gbuffer()};
    return filter(makePixelMeanNode(plane, channels, width_, height_, viewSamples_, overValid), std::move(inputs), label);
  }
  /// Screen motion since motion_step_s before the request's moment.
  Result<NodeId> motion() {
    MotionSettings s{view_, scene_, view_.camera};
    if (request_.has_time_s()) {  // only animation moves: without a time the scene rests
      v1::RenderRequest earlier = request_;
      earlier.set_time_s(request_.time_s() - request_.motion_step_s());
      GOBO_ASSIGN(const EffectiveScene before, makeEffectiveScene(base_, earlier, services_.loadEnvironment, services_.poseScene, services_.stop));
      s.earlierScene = before.scene;
      s.earlierCamera = before.camera;
    }
    return source(makeMotionNode(s), {gbuffer()}, {}, "motion", scene_);
  }
  NodeId variance() {
    std::vector<VarianceWeight> weights;
    std::string without;
    for (const Contribution& c : contributions_) {
      if (c.state >= 0) weights.push_back({int(std::find(states_.begin(), states_.end(), c.state) - states_.begin()), c.slot, c.weight});
      else without += (without.empty() ? "" : ", ") + plan_.graph.at(c.node).label;
    }
    if (!without.empty()) warn("variance: of the path-traced part alone, without " + without);
    if (blocks_ < uint32_t(kVarianceStreams) && !weights.empty())
      warn("variance: from " + std::to_string(blocks_) + " independent blocks of " + std::to_string(blockSize_) + " samples" +
           (blocks_ < 2 ? ": unknown (-1)" : "") + "; " + std::to_string(kVarianceStreams) + " want halt.spp of at least " +
           std::to_string(kVarianceStreams * 16));
    return filter(makeVarianceNode(std::move(weights), int(states_.size()), width_, height_, kVarianceStreams, int(blockSize_)), states_, "variance");
  }

  Status planOutput(const std::string& o) {
    const OutputInfo& info = *findOutput(o);
    const std::string kind = info.name, name(outputLight(o));
    const auto output = [&](NodeId node, std::string plane) { plan_.outputs.push_back({o, node, std::move(plane), info.channelNames()}); };
    const auto composed = [&](const std::function<bool(const Contribution&)>& wanted) { output(compose(o, wanted), "rgb"); };
    const auto part = [&](PathClass classes, LobePart lobe) {
      composed([=](const Contribution& k) { return has(classes, k.pathClass) && (lobe == LobePart::Both || k.lobe == lobe); });
    };
    const PathClass scattered = PathClass::Direct | PathClass::Indirect;
    if (o == "beauty") composed([](const Contribution&) { return true; });
    else if (o == "direct") part(PathClass::Direct, LobePart::Both);
    else if (o == "indirect") part(PathClass::Indirect, LobePart::Both);
    else if (o == "emission") part(PathClass::Emission, LobePart::Both);
    else if (o == "diffuse") part(scattered, LobePart::Diffuse);
    else if (o == "specular") part(scattered, LobePart::Specular);
    else if (o == "direct_diffuse") part(PathClass::Direct, LobePart::Diffuse);
    else if (o == "direct_specular") part(PathClass::Direct, LobePart::Specular);
    else if (o == "indirect_diffuse") part(PathClass::Indirect, LobePart::Diffuse);
    else if (o == "indirect_specular") part(PathClass::Indirect, LobePart::Specular);
    else if (o == "albedo") output(pixelMean(surface(), "albedo", 3, false, o), "albedo");
    else if (o == "normal") output(pixelMean(surface(), "N", 3, true, o), "N");
    else if (o == "position") output(pixelMean(gbuffer(), "P", 3, true, o), "P");
    else if (o == "depth") output(pixelMean(gbuffer(), "depth", 1, true, o), "depth");
    else if (o == "alpha") output(filter(makeAlphaNode(width_, height_, viewSamples_), {gbuffer()}, o), "alpha");
    else if (o == "object_id") output(filter(makeIdNode(IdKind::Object, width_, height_), {gbuffer()}, o), "id");
    else if (o == "material_id") output(source(makeIdNode(IdKind::Material, width_, height_), {gbuffer()}, {}, o, scene_), "id");
    else if (o == "motion") {
      GOBO_ASSIGN(const NodeId node, motion());
      output(node, "motion");
    } else if (o == "sample_count") output(filter(makeSampleCountNode(width_, height_), states_, o), "count");
    else if (o == "variance") output(variance(), "variance");
    else if (kind == "group") {
      const int light = scene_->findLight(name), group = plan_.groups.groupOf[light];
      composed([group](const Contribution& c) { return c.group == group; });
    } else if (kind == "visibility" || kind == "shadow_flags" || kind == "shadow_basis") {
      const int light = scene_->findLight(name);
      v1::ShadowTechnique t = techniqueOf(light, scene_, name);
      if (!findShadowTechnique(t.technique_case())) {
        t.mutable_ray_traced();
        GOBO_TRY(resolveRayTraced(t));
      }
      GOBO_ASSIGN(const NodeId v, visibility(light, scene_, t));
      if (kind == "visibility") output(pixelMean(v, "V", 1, true, o), "V");
      else if (kind == "shadow_basis") {
        const Result<NodeId> mosaic = planBasisMosaic(plan_.graph, v);
        if (!mosaic.ok()) return invalidArgument("request.outputs: '" + o + "': " + mosaic.status().message(), "request.outputs");
        output(*mosaic, "image");
      } else if (marksFailures(t)) output(pixelMean(v, "flags", 1, true, o), "flags");
      else return invalidArgument("request.outputs: '" + o + "' needs shadows.exponential.classification = THRESHOLD or Z_MAX", "request.outputs");
    } else if (kind == "unoccluded") {
      const int light = scene_->findLight(name);
      output(pixelMean(unoccluded(light, scene_, Vec3(nominalScalar(scene_->lights[light]))), "L", 3, false, o), "L");
    }
    return {};
  }

  const ScenePtr& base_;
  const v1::RenderRequest& request_;
  uint32_t blocks_, blockSize_;
  const PlannerServices& services_;
  Plan& plan_;
  ScenePtr scene_;
  int width_, height_, viewSamples_;
  GBufferSettings view_;
  int cameraInVolume_ = -1;  // not asked yet
  MaterialKinds kinds_;
  bool splitClasses_ = false, splitLobes_ = false, variance_ = false;
  std::vector<Contribution> contributions_;
  std::vector<NodeId> states_;  // path tracing states of the beauty
  std::vector<PathClass> cover_;
};

}  // namespace

uint32_t blockSizeFor(uint32_t spp) {
  uint32_t size = 1;  // the realised count, asked for again, has the same blocks: 5 samples are one block of 8, as 8 are
  while (size < spp && size < 16) size *= 2;
  return size;
}

Result<std::unique_ptr<Plan>> makePlan(const ScenePtr& base, const v1::RenderRequest& request, uint32_t blocks, uint32_t blockSize,
                                       const PlannerServices& services) {
  auto plan = std::make_unique<Plan>();
  GOBO_ASSIGN(plan->effective, makeEffectiveScene(base, request, services.loadEnvironment, services.poseScene, services.stop));
  GOBO_TRY(checkOutputs(*plan->effective.scene, request));
  plan->groups = makeGroups(*plan->effective.scene, int(request.integrator().max_groups()), services.stop);
  if (services.stop.stopRequested()) return Status(Code::Cancelled, "stopped");
  PlanMaker maker(base, request, blocks, blockSize, services, *plan);
  GOBO_TRY(maker.make());
  if (services.stop.stopRequested()) return Status(Code::Cancelled, "stopped");
  return plan;
}

}  // namespace gobo

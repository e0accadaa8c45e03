// SPDX-License-Identifier: Apache-2.0
// Nodes of real plans, one by one: requests whose plans hold every type of node between them, and what it takes to run one by hand.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "filters/multiple_axis_aligned/technique.h"
#include "filters/shadow_technique.h"
#include "filters/sheared/technique.h"
#include "plan/disk_store.h"
#include "plan/executor.h"
#include "plan/planner.h"
#include "request/request.h"
#include "scene/builtin/build.h"
#include "scene/load.h"
#include "support/engines.h"
#include "trace/accel.h"
#include "trace/sample_passes.h"

namespace gobo::testing {

/// A clear pane over a floor, under nothing but what a request adds.
inline ScenePtr paneScene() {
  builtin::SceneBuilder b("pane");
  const int floor = b.material("floor", Vec3(0.5f)), clear = b.material("clear", Vec3(0.9f, 0.5f, 0.4f), 0.0f, 0.0f, 1.0f);
  b.at(clear).bsdf.transmission = 1.0f;
  builtin::MeshBuilder ground, pane;
  ground.quad(Vec3(-2, 0, 2), Vec3(4, 0, 0), Vec3(0, 0, -4));
  pane.quad(Vec3(-0.7f, 0.6f, 0.7f), Vec3(1.4f, 0, 0), Vec3(0, 0, -1.4f));
  b.add("ground", ground, floor, false);
  b.add("pane", pane, clear);
  b.camera("front", Vec3(0, 1.8f, 3.2f), Vec3(0, 0.3f, 0), 40.0f);
  return *b.finish();
}

/// Scenes of these plans that no engine knows: "pane", and "successors", which is cornell with the nodes of shadow techniques that no request can name.
inline bool ofPlansAlone(const std::string& scene) { return scene == "pane" || scene == "successors"; }

/// Adds them behind those of the axis-aligned shadow that the graph holds.
inline void addSuccessors(Graph& graph) {
  for (NodeId id = 0, end = graph.size(); id < end; ++id) {
    const GraphNode n = graph.at(id);
    if (n.node->type() != "shadow_slopes") continue;
    ShadowInput in;
    in.scene = n.scene;
    in.light = n.lights.at(0);
    in.gbuffer = n.inputs.at(0);
    const Extent e = graph.at(in.gbuffer).shape.extent;
    in.camera = in.scene->cameras.at(0);
    in.width = e.width;
    in.height = e.height;
    in.viewSamples = e.layers;
    EXPECT_TRUE(planShearedShadow(graph, in, {}).ok());
    EXPECT_TRUE(planMultipleAxisAligned(graph, in, {}).ok());
    return;
  }
  ADD_FAILURE() << "no axis-aligned shadow";
}

/// A plan with what it takes to run its nodes by hand.
struct Planned {
  TaskArena arena;
  TermStore store{512ull << 20};
  ExtensionIndex extensions;
  AccelCache accels;
  std::unique_ptr<Plan> plan;
  std::unique_ptr<Executor> executor;

  explicit Planned(const v1::RenderRequest& asked, int threads = 1) : arena(threads) {
    const auto engine = makeEngine(64ull << 20, {}, threads);
    v1::RenderRequest named = asked;
    if (ofPlansAlone(asked.scene())) named.set_scene("cornell");
    const auto request = engine->resolve(named);
    EXPECT_TRUE(request.ok()) << request.status().toString();
    const ScenePtr scene = asked.scene() == "pane" ? paneScene() : *engine->scene(named.scene());
    PlannerServices services;
    services.expand = [&](const Graph& graph, NodeId node) { return Executor(graph, executorServices(), {}).evaluate(node); };
    auto made = makePlan(scene, *request, passesFor(request->halt().spp()), services);
    EXPECT_TRUE(made.ok()) << made.status().toString();
    plan = std::move(*made);
    if (asked.scene() == "successors") addSuccessors(plan->graph);
    executor = std::make_unique<Executor>(plan->graph, executorServices(), StopToken());
  }
  ExecutorServices executorServices() { return {&store, &extensions, &accels, &arena}; }
  TermPtr input(NodeId id) {
    Result<TermPtr> term = executor->evaluate(id);
    EXPECT_TRUE(term.ok()) << plan->graph.at(id).label << ": " << term.status().toString();
    return term.ok() ? *term : nullptr;
  }

  /// Runs node `id` as the executor does; folds step by step.
  Result<TermPtr> run(NodeId id, const StopToken& stop = {}) {
    std::vector<TermPtr> inputs;
    for (const NodeId i : plan->graph.at(id).inputs) inputs.push_back(input(i));
    return runOn(id, std::move(inputs), stop);
  }
  /// The same on other inputs; an extendable node makes `blocks` (0: as many as it was asked for), from `previous` if that is given.
  Result<TermPtr> runOn(NodeId id, std::vector<TermPtr> inputs, const StopToken& stop = {}, uint32_t blocks = 0, TermPtr previous = nullptr) {
    const GraphNode& n = plan->graph.at(id);
    const Facet facets = n.node->traits().facets;
    RunContext ctx;
    RunCounters counters;
    ctx.arena = &arena;
    ctx.counters = &counters;
    ctx.stop = stop;
    ctx.targetBlocks = blocks ? blocks : n.blocks;
    ctx.previous = std::move(previous);
    std::optional<SceneView> view;
    if (facets != Facet::None) {
      ctx.accels = &accels;
      ctx.scene = &view.emplace(*n.scene, facets, n.lights);
    }
    const auto* fold = dynamic_cast<const FoldNode*>(n.node.get());
    if (!fold) {
      ctx.inputs = std::move(inputs);
      return runNode(*n.node, ctx);
    }
    const int fixed = fold->fixedInputs(), steps = (int(inputs.size()) - fixed) / fold->stride();
    auto state = fold->begin(ctx, {inputs.begin(), inputs.begin() + fixed});
    for (int s = 0; s < steps; ++s) {
      const auto from = inputs.begin() + fixed + s * fold->stride();
      GOBO_TRY(fold->step(ctx, *state, s, {from, from + fold->stride()}));
    }
    ctx.result = makeTerm(n.shape);
    return fold->finish(ctx, std::move(state));
  }
};

inline v1::RenderRequest withLamp(int width, int height, LightKind kind) {
  v1::RenderRequest r = smallRequest("cornell", width, height, 1);
  set(r, std::string("lights.lamp.kind=") + (kind == LightKind::Rect ? "RECT" : "SPOT"));
  for (const char* a : {"lights.lamp.position=0.2,1.6,0.4", "lights.lamp.direction=0,-1,-0.2", "lights.lamp.intensity=3"}) set(r, a);
  return r;
}

inline void addEveryOutput(v1::RenderRequest& r) {
  for (const char* o : {"beauty", "direct", "diffuse", "albedo", "normal", "position", "depth", "z_depth", "alpha", "object_id", "material_id",
                        "cryptomatte_object", "cryptomatte_material", "motion", "sample_count", "variance", "unoccluded:lamp", "visibility:lamp"})
    r.add_outputs(o);
}

/// Requests whose plans hold nodes of every type between them.
inline std::vector<std::pair<std::string, v1::RenderRequest>> requestsWithAllNodes(int width, int height) {
  std::vector<std::pair<std::string, v1::RenderRequest>> all;
  for (const ShadowTechniqueEntry& t : shadowTechniques()) {
    v1::RenderRequest r = withLamp(width, height, t.supports(LightKind::Rect) ? LightKind::Rect : LightKind::Spot);
    v1::ShadowTechnique& technique = *(*r.mutable_lights())["lamp"].mutable_shadow();
    technique.GetReflection()->MutableMessage(&technique, technique.GetDescriptor()->FindFieldByNumber(t.key));
    if (t.usesMap || technique.has_auto_()) technique.mutable_map()->set_resolution(32);
    if (technique.has_auto_()) technique.mutable_auto_()->set_error(0.05);
    if (technique.has_ray_traced()) addEveryOutput(r);
    if (technique.has_axis_aligned()) r.add_outputs("beauty"), r.add_outputs("shadow_rays:lamp");
    if (technique.has_convolution()) r.add_outputs("beauty"), r.add_outputs("shadow_basis:lamp");
    all.emplace_back(t.name, r);
    if (technique.has_auto_()) {  // hard maps are looked at by other nodes than soft ones
      v1::RenderRequest spot = withLamp(width, height, LightKind::Spot);
      *(*spot.mutable_lights())["lamp"].mutable_shadow() = technique;
      all.emplace_back("auto of a spot", spot);
      v1::RenderRequest timed = r;  // time enough for filters to be judged by their windows
      (*timed.mutable_lights())["lamp"].mutable_shadow()->mutable_auto_()->set_time_ms(1000);
      all.emplace_back("auto within a second", timed);
    }
    if (technique.has_percentage_closer()) {
      r.set_scene("pane");
      all.emplace_back("pane", r);
    }
    if (technique.has_axis_aligned()) {
      r.set_scene("successors");
      all.emplace_back("successors", r);
    }
  }
  for (const std::vector<const char*>& as :
       std::vector<std::vector<const char*>>{{"shadows.axis_aligned.mean_samples=12", "shadows.axis_aligned.rate=EQUATION"},
                                             {"shadows.axis_aligned.width=BAND_LIMIT", "shadows.axis_aligned.kernel=GAUSSIAN"},
                                             {"shadows.axis_aligned.adaptive=false"},
                                             {"shadows.percentage_closer.pattern=POISSON", "shadows.percentage_closer.taps=5"},
                                             {"shadows.exponential.classification=Z_MAX"}}) {  // not by default
    v1::RenderRequest r = withLamp(width, height, std::string(as[0]).find("axis") != std::string::npos ? LightKind::Rect : LightKind::Spot);
    set(r, "shadows.map.resolution=32");
    for (const char* a : as) set(r, a);
    all.emplace_back(as[0], r);
  }
  v1::RenderRequest table = withLamp(width, height, LightKind::Spot);
  for (const char* a : {"shadows.variance.bleeding_reduction=0.1", "shadows.map.resolution=32", "shadows.map.lookup=SUMMED_AREA"}) set(table, a);
  all.emplace_back("summed area", table);
  for (const char* as : {"shadows.ray_traced.samples=4", "shadows.percentage_closer.taps=2"}) {
    v1::RenderRequest r = withLamp(width, height, LightKind::Spot);
    for (const char* b : {as, "shadows.map.resolution=32", "shadows.style.softness=0.2", "shadows.style.abstraction=0.1"}) set(r, b);
    all.emplace_back(std::string("styled, ") + as, r);
  }
  v1::RenderRequest drawn = withLamp(width, height, LightKind::Spot);
  for (const char* b : {"shadows.style.softness=0.2", "shadows.style.pattern=HATCHING", "shadows.style.layers[0].abstraction=0.1",
                        "expressions.shadows.style.brightness.formula=0.1*distance", "expressions.shadows.style.abstraction.formula=0.02*depth"})
    set(drawn, b);
  all.emplace_back("styled by formulas", drawn);
  for (const std::vector<const char*>& as :
       std::vector<std::vector<const char*>>{{"shadows.style.samples=7", "shadows.style.guard_px=3"},
                                             {"shadows.style.levels=3", "scene=pane"},
                                             {"shadows.style.metric=SCREEN", "shadows.style.abstraction=0.1", "shadows.style.samples=5"},
                                             {"shadows.style.metric=SCREEN", "shadows.style.abstraction=0.1", "shadows.style.guard_px=2"},
                                             {"shadows.style.metric=SURFACE", "view_samples=2"},
                                             {"shadows.style.hidden_layers=2", "shadows.style.guard_px=2"},
                                             {"shadows.style.hidden_layers=1", "shadows.style.samples=5", "scene=pane"}}) {
    v1::RenderRequest r = withLamp(width, height, LightKind::Spot);
    for (const char* b : {"shadows.percentage_closer.taps=3", "shadows.map.resolution=32", "shadows.style.softness=0.2"}) set(r, b);
    for (const char* b : as) set(r, b);
    all.emplace_back(std::string("styled, ") + as[0] + (as.size() > 2 ? std::string(" ") + as[2] : ""), r);
  }
  v1::RenderRequest shaped = withLamp(width, height, LightKind::Spot);
  for (const char* b : {"shadows.style.elongation=0.3", "shadows.style.target=0.5", "shadows.style.angularity=0.4", "shadows.style.keep=0.5",
                        "shadows.style.inflation=-0.2", "shadows.style.transition=CURVE", "shadows.style.curve=0,1,0.5", "shadows.style.softness=0.2",
                        "shadows.style.layers[0].softness=0.1", "expressions.shadows.style.layers[0].inflation.formula=-0.1*depth",
                        "expressions.shadows.style.layers[0].brightness.formula=0.1*distance", "shadows.style.pattern=HATCHING"})
    set(shaped, b);
  all.emplace_back("styled in shapes", shaped);
  for (const char* as : {"environment.area_lights=6", "environment.extract_lights=6", "environment.transfer.points=300"}) {
    v1::RenderRequest r = smallRequest("cornell", width, height, 1);
    set(r, "environment.sky.turbidity=3");
    set(r, as);
    all.emplace_back(as, r);
  }
  for (const char* as : {"environment.subtractive.resolution=3", "environment.subtractive.bright_lights=0", "environment.subtractive.unshadowed=HARMONICS",
                         "environment.subtractive.unshadowed=RADIANCE_CACHE", "lights.environment.shadow.style.softness=0.2"}) {
    // The first scene has what shines, of which tables take seconds.
    v1::RenderRequest r = smallRequest(std::string(as).find("CACHE") == std::string::npos ? "lights8" : "fence", width, height, 1);
    for (const char* b : {"environment.sky.turbidity=3", as, "environment.subtractive.lights=7"}) set(r, b);
    all.emplace_back(as, r);
  }
  for (const char* as : {"shadows.subtractive.resolution=3", "shadows.subtractive.form=DIFFERENCE"}) {
    v1::RenderRequest r = smallRequest("lights8", width, height, 1);  // has what shines, and lamps of every kind
    for (const char* b : {as, "shadows.subtractive.lights=3", "outputs=beauty,negative_light"}) set(r, b);
    all.emplace_back(as, r);
  }
  for (const char* by : {"STRUCTURED", "WAVELET"}) {
    v1::RenderRequest r = smallRequest("cornell", width, height, 1);
    for (const std::string& a :
         {std::string("environment.sky.turbidity=3"), std::string("environment.extract_lights=6"), std::string("environment.extract_by=") + by})
      set(r, a);
    all.emplace_back(by, r);
  }
  for (const char* as : {"denoise=joint_bilateral", "denoise=auto", "denoise=axis_aligned"}) {
    v1::RenderRequest r = smallRequest("cornell", width, height, 4);
    set(r, as);
    all.emplace_back(as, r);
    if (!r.denoise().has_auto_()) continue;
    for (const char* a : {"camera.lens_radius=0.3", "camera.focus_distance=2"}) set(r, a);
    all.emplace_back("a lens", r);
  }
  for (const char* as : {"denoise.outliers=path_density", "denoise.outliers=trimmed", "denoise.outliers=median_of_means", "denoise.outliers=reweighting"}) {
    for (const char* white : {"0", "0.05"}) {
      v1::RenderRequest r = smallRequest("cornell", width, height, 4);
      for (const std::string& a : {std::string(as), std::string("denoise.outliers.judged=APART"), std::string("denoise.outliers.white=") + white}) set(r, a);
      if (r.denoise().outliers().has_reweighting()) set(r, "denoise.outliers.reweighting.enough=100");  // so that what is around decides
      all.emplace_back(std::string(as) + " of white " + white, r);
    }
  }
  v1::RenderRequest gloss = smallRequest("lights8", width, height, 1);  // has what shines
  for (const char* a : {"environment.sky.turbidity=3", "environment.transfer.points=300", "environment.transfer.samples=64"}) set(gloss, a);
  all.emplace_back("gloss", gloss);
  v1::RenderRequest window = withLamp(width, height, LightKind::Rect);  // with what its filters look at around it, which is cut away
  for (const char* a :
       {"shadows.axis_aligned.radius_px=2", "shadows.axis_aligned.dilate_px=1", "window.x=7", "window.y=6", "window.width=10", "window.height=6"})
    set(window, a);
  all.emplace_back("window", window);
  v1::RenderRequest caustics = smallRequest("spheres", width, height, 1);
  for (const char* a : {"lights.lamp.kind=POINT", "lights.lamp.position=1,3,1", "lights.lamp.intensity=5", "integrator.caustic_photons=500"}) set(caustics, a);
  all.emplace_back("caustics", caustics);
  v1::RenderRequest many = withLamp(width, height, LightKind::Spot);
  for (const char* a : {"integrator.max_groups=1", "shadows.ray_traced.samples=1", "lights.other.kind=POINT", "lights.other.position=0,1,0"}) set(many, a);
  all.emplace_back("cluster", many);
  // Cameras and backgrounds of their own, with everything that reads a camera.
  for (const std::vector<const char*>& edits : std::vector<std::vector<const char*>>{
           {"camera.panorama=true", "camera.position=0.1,1,0.4", "camera.clip_near=0.3", "environment.background=TRANSPARENT"},
           {"camera.focal_x=40", "camera.focal_y=33", "camera.center_x=17.5", "camera.clip_near=3.1", "camera.clip_far=4.2", "environment.background=COLOR",
            "environment.background_color=0.1,0.2,0.7"},
           {"camera.orthographic_height=3", "camera.clip_near=3.2", "camera.clip_far=4", "environment.background=BLURRED",
            "environment.background_blur_deg=40"}}) {
    v1::RenderRequest r = withLamp(width, height, LightKind::Rect);
    set(r, "lights.lamp.shadow.axis_aligned.k=3");
    set(r, "environment.sky.turbidity=3");
    for (const char* e : edits) set(r, e);
    addEveryOutput(r);
    all.emplace_back(edits[0], r);
  }
  v1::RenderRequest filters = withLamp(width, height, LightKind::Spot);
  for (const char* a : {"filters[0].gaussian.sigma_px=0.8", "filters[0].term=direct", "filters[1].median.radius_px=1", "filters[1].term=visibility:lamp",
                        "filters[2].bilateral.sigma_px=0.7", "filters[2].term=indirect", "filters[3].sharpen.amount=0.5", "filters[4].color_balance.blue=0.4",
                        "lights.lamp.shadow.ray_traced.samples=1", "outputs=beauty,direct,indirect,visibility:lamp"})
    set(filters, a);
  all.emplace_back("filters", filters);
  filters.clear_filters();
  for (const char* a : {"filters[0].bloom.threshold=0.1", "filters[1].compression.share=0.2", "filters[2].resample.factor=3", "outputs=beauty"})
    set(filters, a);
  all.emplace_back("filters of whole pictures", filters);
  v1::RenderRequest lens = smallRequest("cornell", width, height, 2);
  for (const char* a : {"camera.lens_radius=0.2", "camera.focus_distance=2.5", "environment.sky.turbidity=3", "environment.background=TRANSPARENT",
                        "outputs=beauty,indirect_diffuse,albedo,normal,position,depth,z_depth,alpha,object_id,motion,cryptomatte_object"})
    set(lens, a);
  all.emplace_back("lens", lens);
  v1::RenderRequest shutter = withLamp(width, height, LightKind::Spot);  // while the camera zooms in
  for (const char* a : {"lights.lamp.shadow.ray_traced.samples=1", "camera.shutter_s=1", "camera.shutter_slices=3", "halt.spp=6",
                        "curves.camera.yfov_deg.time_s=0,1", "curves.camera.yfov_deg.value=50,30", "environment.sky.turbidity=3",
                        "environment.background=TRANSPARENT", "outputs=beauty,direct,albedo,alpha,sample_count,cryptomatte_material"})
    set(shutter, a);
  all.emplace_back("shutter", shutter);
  for (const char* a : {"denoise.wavelet.levels=2", "halt.spp=3", "camera.lens_radius=0.1", "camera.focus_distance=2.5", "lights.lamp.shadow.path_traced={}"})
    set(shutter, a);
  all.emplace_back("shutter_denoised", shutter);
  return all;
}

}  // namespace gobo::testing

// SPDX-License-Identifier: Apache-2.0
// Every node of every kind of plan, one by one: with a token that has fired it does not finish; with one that has not it looks at it all
// along, however cheap its work (a pass over a large picture that does not look holds the cores for a third of a second).
#include <gtest/gtest.h>

#include <set>

#include "filters/shadow_technique.h"
#include "plan/disk_store.h"
#include "plan/executor.h"
#include "plan/planner.h"
#include "request/request.h"
#include "scene/load.h"
#include "support/engines.h"
#include "support/stopping.h"
#include "trace/accel.h"

namespace gobo::testing {
namespace {

using tests::pollsOf;
using tests::stoppedAlready;

/// Most elements of its result that a node makes between two polls.
constexpr size_t kElementsAPoll = 1 << 15;

/// A plan with what it takes to run its nodes by hand.
struct Planned {
  TaskArena arena{1};
  TermStore store{512ull << 20};
  ExtensionIndex extensions;
  AccelCache accels;
  std::unique_ptr<Plan> plan;
  std::unique_ptr<Executor> executor;

  explicit Planned(const v1::RenderRequest& asked) {
    const auto engine = makeEngine(64ull << 20, {}, 1);
    const auto request = engine->resolve(asked);
    EXPECT_TRUE(request.ok()) << request.status().toString();
    const ScenePtr scene = *engine->scene(asked.scene());
    const uint32_t size = blockSizeFor(request->halt().spp());
    PlannerServices services;
    services.expand = [&](const Graph& graph, NodeId node) { return Executor(graph, executorServices(), {}).evaluate(node); };
    auto made = makePlan(scene, *request, (request->halt().spp() + size - 1) / size, size, services);
    EXPECT_TRUE(made.ok()) << made.status().toString();
    plan = std::move(*made);
    executor = std::make_unique<Executor>(plan->graph, executorServices(), StopToken());
  }
  ExecutorServices executorServices() { return {&store, &extensions, &accels, &arena}; }
  TermPtr input(NodeId id) {
    Result<TermPtr> term = executor->evaluate(id);
    EXPECT_TRUE(term.ok()) << plan->graph.at(id).label << ": " << term.status().toString();
    return term.ok() ? *term : nullptr;
  }

  /// Runs node `id` as the executor does; folds step by step.
  Result<TermPtr> run(NodeId id, const StopToken& stop) {
    const GraphNode& n = plan->graph.at(id);
    const Facet facets = n.node->traits().facets;
    RunContext ctx;
    RunCounters counters;
    ctx.arena = &arena;
    ctx.counters = &counters;
    ctx.stop = stop;
    ctx.targetBlocks = n.blocks;
    std::optional<SceneView> view;
    if (facets != Facet::None) {
      ctx.accels = &accels;
      ctx.scene = &view.emplace(*n.scene, facets, n.lights);
    }
    const auto* fold = dynamic_cast<const FoldNode*>(n.node.get());
    std::vector<TermPtr> inputs;
    for (const NodeId i : n.inputs) inputs.push_back(input(i));
    if (!fold) {
      ctx.inputs = std::move(inputs);
      return n.node->run(ctx);
    }
    const int fixed = fold->fixedInputs(), steps = (int(inputs.size()) - fixed) / fold->stride();
    auto state = fold->begin(ctx, {inputs.begin(), inputs.begin() + fixed});
    for (int s = 0; s < steps; ++s) {
      const auto from = inputs.begin() + fixed + s * fold->stride();
      GOBO_TRY(fold->step(ctx, *state, s, {from, from + fold->stride()}));
    }
    return fold->finish(ctx, std::move(state));
  }
};

v1::RenderRequest withLamp(int width, int height, LightKind kind) {
  v1::RenderRequest r = smallRequest("cornell", width, height, 1);
  set(r, std::string("lights.lamp.kind=") + (kind == LightKind::Rect ? "RECT" : "SPOT"));
  for (const char* a : {"lights.lamp.position=0.2,1.6,0.4", "lights.lamp.direction=0,-1,-0.2", "lights.lamp.intensity=3"}) set(r, a);
  return r;
}

void addEveryOutput(v1::RenderRequest& r) {
  for (const char* o : {"beauty", "direct", "diffuse", "albedo", "normal", "position", "depth", "alpha", "object_id", "material_id", "motion", "sample_count",
                        "variance", "unoccluded:lamp", "visibility:lamp"})
    r.add_outputs(o);
}

/// Requests whose plans hold nodes of every type between them.
std::vector<std::pair<std::string, v1::RenderRequest>> requests(int width, int height) {
  std::vector<std::pair<std::string, v1::RenderRequest>> all;
  for (const ShadowTechniqueEntry& t : shadowTechniques()) {
    v1::RenderRequest r = withLamp(width, height, t.supports(LightKind::Rect) ? LightKind::Rect : LightKind::Spot);
    v1::ShadowTechnique& technique = *(*r.mutable_lights())["lamp"].mutable_shadow();
    technique.GetReflection()->MutableMessage(&technique, technique.GetDescriptor()->FindFieldByNumber(t.key));
    if (t.usesMap || technique.has_auto_()) technique.mutable_map()->set_resolution(32);
    if (technique.has_auto_()) technique.mutable_auto_()->set_error(0.05);
    if (technique.has_ray_traced()) addEveryOutput(r);
    all.emplace_back(t.name, r);
  }
  for (const char* as : {"environment.area_lights=6", "environment.extract_lights=6"}) {
    v1::RenderRequest r = smallRequest("cornell", width, height, 1);
    set(r, "environment.sky.turbidity=3");
    set(r, as);
    all.emplace_back(as, r);
  }
  v1::RenderRequest caustics = smallRequest("spheres", width, height, 1);
  for (const char* a : {"lights.lamp.kind=POINT", "lights.lamp.position=1,3,1", "lights.lamp.intensity=5", "integrator.caustic_photons=500"}) set(caustics, a);
  all.emplace_back("caustics", caustics);
  v1::RenderRequest many = withLamp(width, height, LightKind::Spot);
  for (const char* a : {"integrator.max_groups=1", "shadows.ray_traced.samples=1", "lights.other.kind=POINT", "lights.other.position=0,1,0"}) set(many, a);
  all.emplace_back("cluster", many);
  return all;
}

TEST(NodeStops, NoNodeFinishesOnceItsTokenHasFired) {
  std::set<std::string> types;
  for (const auto& [name, request] : requests(24, 16)) {
    Planned p(request);
    ASSERT_NE(p.plan, nullptr);
    for (NodeId id = 0; id < p.plan->graph.size(); ++id) {
      const GraphNode& n = p.plan->graph.at(id);
      types.insert(n.node->type());
      const auto result = p.run(id, stoppedAlready());
      EXPECT_FALSE(result.ok()) << name << ", node " << n.label << " (" << n.node->type() << ")";
      if (result.ok()) continue;
      EXPECT_EQ(result.status().code(), Code::Cancelled) << name << ", node " << n.label << ": " << result.status().toString();
    }
  }
  EXPECT_GE(types.size(), 30u);
  for (const char* type : {"resolve", "pixel_mean", "shade", "direct_fold", "alpha", "composite", "path_trace", "caustics", "gbuffer"})
    EXPECT_TRUE(types.count(type)) << type;
}

TEST(NodeStops, EveryNodeLooksAtItsTokenAllAlong) {
  const std::set<std::string> drawn{"ray_traced", "axis_aligned", "environment.area_lights=6", "cluster"};  // the others' own nodes work texel by texel
  for (const auto& [name, request] : requests(224, 160)) {
    if (!drawn.count(name)) continue;
    Planned p(request);
    ASSERT_NE(p.plan, nullptr);
    for (NodeId id = 0; id < p.plan->graph.size(); ++id) {
      const GraphNode& n = p.plan->graph.at(id);
      size_t elements = 0;
      const int polls = pollsOf([&](const StopToken& s) {
        const auto result = p.run(id, s);
        ASSERT_TRUE(result.ok()) << n.label << ": " << result.status().toString();
        elements = (*result)->extent().elements();
      });
      EXPECT_GE(size_t(polls), (elements + kElementsAPoll - 1) / kElementsAPoll)
          << name << ", node " << n.label << " (" << n.node->type() << "), " << elements << " elements";
    }
  }
}

TEST(NodeStops, TheCheckForNonFiniteValuesStops) {
  Term term("big", Domain::Pixel, {2048, 1024, 1});
  (void)term.addPlane<float>("v", 3);
  TaskArena arena(1);
  EXPECT_GE(pollsOf([&](const StopToken& s) { ASSERT_TRUE(firstNonFinite(term, arena, s).ok()); }), 24);
  EXPECT_EQ(firstNonFinite(term, arena, stoppedAlready()).status().code(), Code::Cancelled);
}

}  // namespace
}  // namespace gobo::testing

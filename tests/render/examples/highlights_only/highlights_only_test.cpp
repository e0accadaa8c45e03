// SPDX-License-Identifier: Apache-2.0
// A technique from outside (docs/add_a_technique.md): the direct highlights of one lamp by unoccluded light times visibility, all other paths by the
// path tracer, which is left a class cut in two. Together they are the picture; outputs find the new plane by what it holds.
#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "filters/composite.h"
#include "plan/disk_store.h"
#include "plan/executor.h"
#include "plan/planner.h"
#include "scene/load.h"
#include "support/engines.h"
#include "technique/plan_context.h"
#include "techniques/direct_visibility/visibility.h"
#include "techniques/path_traced/technique.h"
#include "trace/accel.h"
#include "trace/sample_passes.h"

namespace gobo::testing {
namespace {

v1::ShadowTechnique rays() {
  v1::ShadowTechnique t;
  t.mutable_ray_traced()->set_samples(16);
  return t;
}

class HighlightsOnly final : public Technique {
 public:
  explicit HighlightsOnly(PathSet claims = PathSet::FrontSpecular) : claims_(claims) {}
  const char* name() const override { return "highlights_only"; }
  Status claim(PlanContext& c) const override { return c.cover().claim(c.scene()->findLight("lamp"), claims_, name()); }
  Status plan(PlanContext& c) const override {
    const int lamp = c.scene()->findLight("lamp"), group = c.groups().groupOf[size_t(lamp)];
    GOBO_TRY(c.cover().bring(lamp, PathSet::FrontSpecular, name()));
    const NodeId light = planUnoccluded(c, lamp, c.scene(), c.groups().nominal[size_t(lamp)], false, LobePart::Specular);
    GOBO_ASSIGN(const NodeId visible, planVisibility(c, lamp, c.scene(), rays()));
    const GBufferSettings& view = c.view();
    c.add({c.filter(makeShadeNode(view.width, view.height, view.viewSamples), {light, visible}, "highlights:lamp"), "rgb", c.groupGain(group),
           PathSet::FrontSpecular, group});
    return {};
  }

 private:
  PathSet claims_;
};

struct Planner {
  std::unique_ptr<Engine> engine = makeEngine(256ull << 20, {}, 2);
  TaskArena arena{2};
  TermStore store{512ull << 20};
  ExtensionIndex extensions;
  AccelCache accels;

  v1::RenderRequest request() const {
    v1::RenderRequest r = smallRequest("spheres", 48, 32, 256);
    for (const char* a : {"lights.lamp.kind=RECT", "lights.lamp.position=1,3,1", "lights.lamp.direction=-0.3,-1,-0.3", "lights.lamp.intensity=6",
                          "integrator.at_view_samples=true", "outputs=beauty,direct_specular,direct_diffuse"})
      set(r, a);
    return *engine->resolve(r);
  }
  Result<std::unique_ptr<Plan>> plan(std::span<const Technique* const> techniques) {
    PlannerServices services;
    services.techniques = techniques;
    services.expand = [&](const Graph& graph, NodeId node) { return Executor(graph, {&store, &extensions, &accels, &arena}, {}).evaluate(node); };
    return makePlan(*engine->scene("spheres"), request(), passesFor(256), services);
  }
  std::vector<TermPtr> pictures(const Plan& plan) {
    Executor executor(plan.graph, {&store, &extensions, &accels, &arena}, {});
    std::vector<TermPtr> out;
    for (const PlannedOutput& o : plan.outputs) {
      const auto term = executor.evaluate(o.node);
      EXPECT_TRUE(term.ok()) << term.status().toString();
      out.push_back(*term);
    }
    return out;
  }
};

double mean(const Term& picture) {
  double sum = 0;
  for (const float v : picture.floats("rgb")) sum += double(v);
  return sum / double(picture.floats("rgb").size());
}

TEST(HighlightsOnly, TheRestComesFromThePathTracer) {
  Planner p;
  ASSERT_TRUE(p.engine->inspectScene("spheres").ok());
  const HighlightsOnly highlights;
  const std::array<const Technique*, 2> both{&pathTraced(), &highlights};
  const std::array<const Technique*, 1> alone{&pathTraced()};
  const auto mixed = p.plan(both), traced = p.plan(alone);
  ASSERT_TRUE(mixed.ok() && traced.ok()) << mixed.status().toString() << traced.status().toString();
  EXPECT_EQ((*mixed)->missing, (*traced)->missing);
  const auto a = p.pictures(**mixed), b = p.pictures(**traced);
  for (size_t k = 0; k < a.size(); ++k) {
    SCOPED_TRACE((*mixed)->outputs[k].name);
    const double x = mean(*a[k]), y = mean(*b[k]);
    EXPECT_GT(y, 1e-3);
    EXPECT_NEAR(x, y, 0.02 * y);
  }
  double different = 0;  // it is another estimate, not the same planes
  for (size_t i = 0; i < a[1]->floats("rgb").size(); ++i) different = std::max(different, std::abs(double(a[1]->floats("rgb")[i]) - b[1]->floats("rgb")[i]));
  EXPECT_GT(different, 0.0);
  bool named = false;
  for (NodeId id = 0; id < (*mixed)->graph.size(); ++id) named = named || (*mixed)->graph.at(id).label == "highlights:lamp";
  EXPECT_TRUE(named);
}

TEST(HighlightsOnly, AClaimThatIsNotBroughtOrOverlapsIsAnErrorWhilePlanning) {
  Planner p;
  ASSERT_TRUE(p.engine->inspectScene("spheres").ok());
  const HighlightsOnly greedy(PathSet::Front), right, again;
  const std::array<const Technique*, 2> forgets{&pathTraced(), &greedy};
  const auto forgotten = p.plan(forgets);
  ASSERT_FALSE(forgotten.ok());
  EXPECT_NE(forgotten.status().message().find("did not bring"), std::string::npos) << forgotten.status().toString();
  struct Other final : Technique {
    const char* name() const override { return "other"; }
    Status claim(PlanContext& c) const override { return c.cover().claim(c.scene()->findLight("lamp"), PathSet::Direct, name()); }
    Status plan(PlanContext&) const override { return {}; }
  } other;
  const std::array<const Technique*, 3> overlap{&pathTraced(), &right, &other};
  const auto overlapping = p.plan(overlap);
  ASSERT_FALSE(overlapping.ok());
  EXPECT_NE(overlapping.status().message().find("highlights_only"), std::string::npos) << overlapping.status().toString();
}

}  // namespace
}  // namespace gobo::testing

// SPDX-License-Identifier: Apache-2.0
#include "techniques/caustics/technique.h"

#include "filters/composite.h"
#include "techniques/caustics/caustic_plan.h"
#include "techniques/path_traced/trace_paths.h"
#include "terms/caustics.h"

namespace gobo {
inline namespace techniques {

namespace {

class CausticPhotons final : public Technique {
 public:
  const char* name() const override { return "caustics"; }
  bool seesThroughLens() const override { return true; }

  Status plan(PlanContext& c) const override {
    if (c.scene()->lights.empty()) return {};
    const CausticPlan plan = causticPlan(*c.scene(), c.kinds(), c.request().integrator());
    if (!plan.pruned.empty()) c.prune("caustics", plan.pruned, plan.lost);
    const bool lobes = c.apart().lobes;
    for (const CausticTask& t : causticTasks(plan, c.effective(), c.groups(), pathTracerSettings(c, PathClass::Indirect), lobes)) {
      GraphNode n{makeCausticsNode(t.settings, c.view(), c.share()), {}, t.lights, t.label, c.passes(), c.scene(), false, causticNote(plan, c.passes())};
      for (int l : t.lights) {
        if (t.groups.size() == 1 && c.cover().claimedBy(l, name()) != PathSet::None) continue;  // a difference to what its cluster holds
        GOBO_TRY(c.cover().claim(l, PathSet::Caustic, name()));
        GOBO_TRY(c.cover().bring(l, PathSet::Caustic, name()));
      }
      const NodeId state = c.graph().add(std::move(n));
      const NodeId mean = c.filter(makeResolveNode(c.view().width, c.view().height, t.settings.slots()), {state}, t.label + ":mean");
      for (int slot = 0; slot < t.settings.slots(); ++slot) {
        const size_t g = size_t(lobes ? slot / 2 : slot);
        const PathSet paths = PathSet::Caustic & (!lobes ? PathSet::All : slot % 2 ? PathSet::Specular : PathSet::Diffuse);
        c.add({mean, "s" + std::to_string(slot), t.weights[g], paths, t.groups[g]});
      }
    }
    // A class that is held may still lack paths that nothing finds.
    if (c.request().integrator().indirect())
      for (const std::string& lost : classesNotCovered(*c.scene(), plan.photons > 0)) c.miss(lost);
    return {};
  }
};

}  // namespace

const Technique& causticPhotons() {
  static const CausticPhotons technique;
  return technique;
}

}  // namespace techniques
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "techniques/background/technique.h"

#include "filters/composite.h"
#include "filters/sample_statistics.h"
#include "technique/plan_context.h"
#include "techniques/path_traced/trace_paths.h"
#include "terms/path_trace.h"

namespace gobo {
inline namespace techniques {

namespace {

class BackgroundTechnique final : public Technique {
 public:
  const char* name() const override { return kBackgroundTechnique; }
  bool seesThroughLens() const override { return true; }

  Status claim(PlanContext& c) const override {
    const int hidden = c.effective().background.hidden;
    return hidden < 0 ? Status() : c.cover().claim(hidden, PathSet::Emission, name());
  }

  Status plan(PlanContext& c) const override {
    const Background& b = c.effective().background;
    if (b.hidden >= 0) GOBO_TRY(c.cover().bring(b.hidden, PathSet::Emission, name()));
    if (!b.scene) return {};
    GOBO_ASSIGN(const NodeId state, traceSeen(c, b.light, Vec3(1.0f), b.scene, "background"));
    const NodeId mean = c.filter(makeResolveNode(c.view().width, c.view().height, 1), {state}, "background:mean");
    if (b.transparent) c.setClear(mean);
    const int group = b.ofMap ? c.groups().groupOf[size_t(b.hidden)] : -1;
    c.add({mean, "s0", b.weight, PathSet::Emission, group, state, 0});
    return {};
  }
};

}  // namespace

const Technique& background() {
  static const BackgroundTechnique technique;
  return technique;
}

}  // namespace techniques
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "techniques/environment_lights/light_folds.h"

#include <algorithm>

#include "filters/composite.h"
#include "filters/shadow_technique.h"
#include "techniques/direct_visibility/visibility.h"

namespace gobo {
inline namespace techniques {

namespace {
constexpr uint64_t kKeptBytes = uint64_t(256) << 20;
}

Status foldLights(PlanContext& c, const ScenePtr& extended, int first, const Vec3& nominal, int group, uint32_t samples, const std::vector<LobePart>& lobes) {
  const int count = int(extended->lights.size()) - first;
  v1::ShadowTechnique t = shadowTechniqueOf(c, first, extended, "environment");
  if (!findShadowTechnique(t.technique_case())) t.mutable_ray_traced()->set_samples(samples);
  c.surface();  // made (and kept) before any node that is marked transient below
  const uint64_t kept = uint64_t(count) * c.view().width * c.view().height * c.view().viewSamples *
                        (t.has_style() ? 40 : 16);  // a style holds its distance and what it makes of it
  const bool keep = kept <= kKeptBytes;
  if (c.bounding()) c.reserve(std::min(kept, kKeptBytes));  // fewer lights than asked for may be kept where all of them would not
  for (const LobePart lobe : lobes) {
    std::vector<NodeId> pairs;
    for (int l = first; l < first + count; ++l) {
      if (c.stop().stopRequested()) return Status(Code::Cancelled, "stopped");
      const int before = c.graph().size();
      pairs.push_back(planUnoccluded(c, l, extended, extended->lights[size_t(l)].power * nominal, !keep, lobe));
      GOBO_ASSIGN(const NodeId v, planVisibility(c, l, extended, t, "environment"));
      if (!keep) c.graph().markTransient(before, v);
      pairs.push_back(v);
    }
    const NodePtr fold = makeDirectFoldNode(c.view().width, c.view().height, c.view().viewSamples, count);
    c.add({c.filter(fold, std::move(pairs), withLobe("direct:environment", lobe)), "rgb", c.groupGain(group), front(lobe), group});
  }
  return {};
}

}  // namespace techniques
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "techniques/direct_visibility/technique.h"

#include <map>

#include "filters/composite.h"
#include "filters/shadow_technique.h"
#include "techniques/direct_visibility/filtered.h"
#include "techniques/direct_visibility/visibility.h"
#include "techniques/path_traced/technique.h"
#include "techniques/path_traced/trace_paths.h"

namespace gobo {
inline namespace techniques {

namespace {

class DirectVisibility final : public Technique {
 public:
  const char* name() const override { return "direct_visibility"; }

  Status claim(PlanContext& c) const override {
    for (int l = 0; l < int(c.scene()->lights.size()); ++l) {
      const v1::ShadowTechnique t = techniqueOf(c, l);
      if (t.has_auto_() && c.view().camera.hasLens()) continue;  // path tracing is all that there is to choose from
      if (!findShadowTechnique(t.technique_case())) continue;
      GOBO_TRY(c.cover().claim(l, PathSet::Direct, name()));
      if (changeInCluster(c, l) != Vec3(0.0f)) c.claimAtGains(l, c.kinds().translucent ? PathSet::Front : PathSet::Direct);
    }
    return {};
  }

  Status plan(PlanContext& c) const override {
    warnOfMaps(c);
    std::vector<int> viewed;
    for (int l = 0; l < int(c.scene()->lights.size()); ++l)
      if (c.cover().claimedBy(l, name()) != PathSet::None) viewed.push_back(l);
    if (viewed.empty()) return {};
    std::map<std::pair<int, LobePart>, std::vector<NodeId>> folds;  // cluster group -> pairs (L, V)
    c.surface();                                                    // made (and kept) before any node that is marked transient below
    for (int l : viewed) GOBO_TRY(planLight(c, l, folds));
    for (auto& [key, pairs] : folds) {
      const auto [group, lobe] = key;
      const NodePtr fold = makeDirectFoldNode(c.view().width, c.view().height, c.view().viewSamples, int(pairs.size() / 2));
      c.add({c.filter(fold, std::move(pairs), withLobe("direct:" + c.groupName(group), lobe)), "rgb", c.groupGain(group), front(lobe), group});
    }
    if (c.kinds().translucent) return tracePaths(c, name(), viewed, PathSet::Behind, "through");
    for (int l : viewed) GOBO_TRY(c.cover().bring(l, PathSet::Behind, name()));  // no surface lets any through
    return {};
  }

 private:
  /// What a request adds to a light of a cluster, over what the cluster holds of it. Brought by the light's own shadow: paths would take off what a style or
  /// a map of it has not.
  static Vec3 changeInCluster(PlanContext& c, int light) {
    return c.groups().single(c.groups().groupOf[size_t(light)]) ? Vec3(0.0f) : c.effective().gainChanges[size_t(light)];
  }

  /// Of maps that the path tracer was left with, which is planned first.
  static void warnOfMaps(PlanContext& c) {
    for (int l = 0; l < int(c.scene()->lights.size()); ++l) {
      const Light& light = c.scene()->lights[size_t(l)];
      if (light.shape.kind != LightKind::Environment || !overlaps(c.cover().claimedBy(l, pathTraced().name()), PathSet::Direct)) continue;
      const auto edit = c.request().lights().find(light.name);
      const bool own = edit != c.request().lights().end() && edit->second.has_shadow();
      if ((own ? edit->second.shadow() : c.request().shadows()).has_style())
        c.warn("light '" + light.name + "' is path traced: it has no shadow for shadows.style");
    }
  }

  static v1::ShadowTechnique techniqueOf(PlanContext& c, int light) { return shadowTechniqueOf(c, light, c.scene(), c.scene()->lights[size_t(light)].name); }

  Status planLight(PlanContext& c, int l, std::map<std::pair<int, LobePart>, std::vector<NodeId>>& folds) const {
    if (c.stop().stopRequested()) return Status(Code::Cancelled, "stopped");
    const int group = c.groups().groupOf[size_t(l)];
    const bool single = c.groups().single(group);
    const std::string& light = c.scene()->lights[size_t(l)].name;
    GOBO_TRY(c.cover().bring(l, PathSet::Front, name()));
    if (single && c.groupGain(group) == Vec3(0.0f)) {
      c.prune("direct:" + light, "its gain is zero");
      return {};
    }
    const int before = c.graph().size();
    std::vector<NodeId> parts;
    for (const LobePart lobe : c.lobes()) parts.push_back(planUnoccluded(c, l, c.scene(), c.groups().nominal[size_t(l)], !single, lobe));
    GOBO_ASSIGN(const NodeId unfiltered, planVisibility(c, l, c.scene(), techniqueOf(c, l)));
    const NodeId v = planFilteredVisibility(c, unfiltered, light);
    if (!single) c.graph().markTransient(before, v);
    for (size_t k = 0; k < parts.size(); ++k) {
      const LobePart lobe = c.lobes()[k];
      if (single) {
        const NodePtr shade = makeShadeNode(c.view().width, c.view().height, c.view().viewSamples);
        c.add({c.filter(shade, {parts[k], v}, withLobe("direct:" + light, lobe)), "rgb", c.groupGain(group), front(lobe), group});
      } else {
        folds[{group, lobe}].push_back(parts[k]);
        folds[{group, lobe}].push_back(v);
        const Vec3 change = changeInCluster(c, l);
        if (change == Vec3(0.0f)) continue;
        const NodeId own = planUnoccluded(c, l, c.scene(), Vec3(nominalScalar(c.scene()->lights[size_t(l)])), true, lobe);
        c.add({c.filter(makeShadeNode(c.view().width, c.view().height, c.view().viewSamples), {own, v}, withLobe("difference:" + light, lobe)), "rgb", change,
               front(lobe), group});
      }
    }
    return {};
  }
};

}  // namespace

const Technique& directVisibility() {
  static const DirectVisibility technique;
  return technique;
}

}  // namespace techniques
}  // namespace gobo

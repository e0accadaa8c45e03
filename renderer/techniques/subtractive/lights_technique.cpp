// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>

#include "techniques/direct_visibility/visibility.h"
#include "techniques/path_traced/trace_paths.h"
#include "techniques/subtractive/request_fields.h"
#include "techniques/subtractive/scene_lights.h"
#include "techniques/subtractive/technique.h"

namespace gobo {
inline namespace techniques {

namespace {

constexpr int kUnshadowedSamples = 32;

/// Lights of the same settings are one set.
struct LightSet {
  v1::SubtractiveShadow asked;
  std::vector<int> lights;
};

class SubtractiveLights final : public Technique {
 public:
  const char* name() const override { return "subtractive_lights"; }

  Status claim(PlanContext& c) const override {
    for (int l = 0; l < int(c.scene()->lights.size()); ++l) {
      if (!techniqueOf(c, l).has_subtractive()) continue;
      GOBO_TRY(c.cover().claim(l, PathSet::Direct, name()));
      c.claimAtGains(l, c.kinds().translucent ? PathSet::Front : PathSet::Direct);
    }
    return {};
  }

  Status plan(PlanContext& c) const override {
    std::map<std::string, LightSet> sets;
    std::vector<int> claimed;
    for (int l = 0; l < int(c.scene()->lights.size()); ++l) {
      if (c.cover().claimedBy(l, name()) == PathSet::None) continue;
      const v1::ShadowTechnique t = techniqueOf(c, l);
      LightSet& set = sets[t.subtractive().SerializeAsString()];
      set.asked = t.subtractive();
      set.lights.push_back(l);
      claimed.push_back(l);
    }
    if (claimed.empty()) return {};
    std::vector<const LightSet*> inOrder;  // of their first lights
    for (const auto& [key, set] : sets) inOrder.push_back(&set);
    std::sort(inOrder.begin(), inOrder.end(), [](const LightSet* a, const LightSet* b) { return a->lights[0] < b->lights[0]; });
    for (const LightSet* set : inOrder) GOBO_TRY(planSet(c, *set));
    if (c.kinds().translucent) return tracePaths(c, name(), claimed, PathSet::Behind, "through subtractive");
    for (int l : claimed) GOBO_TRY(c.cover().bring(l, PathSet::Behind, name()));  // no surface lets any through
    return {};
  }

 private:
  static v1::ShadowTechnique techniqueOf(PlanContext& c, int light) { return shadowTechniqueOf(c, light, c.scene(), c.scene()->lights[size_t(light)].name); }

  /// A light alone is traced at its nominal power, and its gain is the plane's weight. Of several the gains are part of what is seen of them together.
  Status planSet(PlanContext& c, const LightSet& set) const {
    const bool alone = set.lights.size() == 1 && c.groups().single(c.groups().groupOf[size_t(set.lights[0])]);
    const std::string label = set.lights.size() == 1
                                  ? c.scene()->lights[size_t(set.lights[0])].name
                                  : c.scene()->lights[size_t(set.lights[0])].name + " and " + std::to_string(set.lights.size() - 1) + " more";
    subtractive::SceneLightsSettings from;
    from.view = c.view();
    from.samples = kUnshadowedSamples;
    std::vector<int> lit, groups;
    for (int l : set.lights) {
      GOBO_TRY(c.cover().bring(l, PathSet::Front, name()));
      const Light& light = c.scene()->lights[size_t(l)];
      const Vec3 gain = c.effective().gains[size_t(l)];
      if (gain == Vec3(0.0f)) continue;
      lit.push_back(l);
      groups.push_back(c.groups().groupOf[size_t(l)]);
      from.lights.push_back({l, alone ? Vec3(nominalScalar(light)) : gain * nominalScalar(light)});
      if (!isDeltaLight(light.shape)) from.seed = c.request().seed();
    }
    if (lit.empty()) {
      c.prune("subtractive:" + label, set.lights.size() == 1 ? "its gain is zero" : "their gains are zero");
      return {};
    }
    std::sort(groups.begin(), groups.end());
    groups.erase(std::unique(groups.begin(), groups.end()), groups.end());

    const subtractive::Resampling resampling = subtractive::resamplingOf(set.asked);
    const int most = int(set.asked.lights()), rays = std::min(most, int(lit.size()));
    const NodeId samples =
        c.source(subtractive::makeLightSamplesNode({from, resampling, most}), {c.gbuffer(), c.surface()}, lit, "subtractive_samples:" + label, c.scene());
    const NodeId full = c.source(subtractive::makeUnshadowedLightsNode(from), {c.gbuffer(), c.surface()}, lit, "unshadowed:" + label, c.scene());
    GraphNode n{subtractive::makeLightNode({c.view(), resampling, subtractive::formOf(set.asked), rays}),
                {c.gbuffer(), c.surface(), samples, full},
                {},
                "subtractive:" + label};
    const bool few = rays < int(lit.size());
    if (few || resampling.resolution > 1)
      n.approximate = "unshadowed light of " + std::to_string(lit.size()) + (lit.size() == 1 ? " light" : " lights") + " with the shadows of " +
                      (few               ? "the " + std::to_string(rays) + " that give most at each sample"
                       : lit.size() == 1 ? std::string("it")
                                         : std::string("all")) +
                      " at 1/" + std::to_string(resampling.resolution) + " of the resolution";
    const NodeId light = c.graph().add(std::move(n));
    const auto bring = [&](const char* plane, PathSet paths) {
      Contribution k{light, plane, alone ? c.groupGain(groups[0]) : Vec3(1.0f), paths, groups.size() == 1 ? groups[0] : -1};
      if (groups.size() > 1) k.together = groups;
      return k;
    };
    c.add(bring("diffuse", PathSet::FrontDiffuse));
    if (!c.kinds().lambert) c.add(bring("specular", PathSet::FrontSpecular));
    c.addNegative(bring("negative", PathSet::Front));
    return {};
  }
};

}  // namespace

const Technique& subtractiveLights() {
  static const SubtractiveLights technique;
  return technique;
}

}  // namespace techniques
}  // namespace gobo

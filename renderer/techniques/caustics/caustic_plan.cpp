// SPDX-License-Identifier: Apache-2.0
#include "techniques/caustics/caustic_plan.h"

#include <algorithm>
#include <cstdio>

#include "trace/sample_passes.h"

namespace gobo {
inline namespace techniques {

// Photons have specular chains alone: the plan looks for nothing else.
static_assert(!photonReaches(LightShape{}, Receiver::Surface, Passage::Boundary) && !photonReaches(LightShape{}, Receiver::Surface, Passage::Pane));

CausticPlan causticPlan(const Scene& scene, const MaterialKinds& kinds, const v1::Integrator& integrator) {
  CausticPlan plan;
  const bool lights =
      std::any_of(scene.lights.begin(), scene.lights.end(), [](const Light& l) { return photonReaches(l.shape, Receiver::Surface, Passage::Specular); });
  const bool some = lights && kinds.specular, asked = integrator.caustic_photons() > 0;
  Vec3 lo, hi;
  scene.bounds(lo, hi);
  const float radius = float(integrator.caustic_radius()) * glm::length(hi - lo);
  if (!asked) plan.pruned = some ? "integrator.caustic_photons is 0" : "";
  else if (!lights) plan.pruned = "the scene has no point, spot or hard directional light";
  else if (!kinds.specular) plan.pruned = "no surface is a mirror or smooth glass";
  else if (!integrator.indirect() || integrator.max_bounces() == 0) plan.pruned = "indirect light is off";
  else if (!(radius > 0.0f) || !std::isfinite(radius)) plan.pruned = "the scene has no size";
  plan.lost = some && !plan.pruned.empty();
  if (asked && plan.pruned.empty()) {
    plan.photons = integrator.caustic_photons();
    plan.radius = radius;
  }
  return plan;
}

std::vector<CausticTask> causticTasks(const CausticPlan& plan, const EffectiveScene& effective, const RelightGroups& relight, const PathTracerSettings& path,
                                      bool byLobe) {
  if (plan.photons == 0) return {};
  const std::vector<Light>& lights = effective.scene->lights;
  CausticTask all;
  all.label = "caustics";
  all.settings.path = path;
  all.settings.photons = plan.photons;
  all.settings.radius = plan.radius;
  all.settings.byLobe = byLobe;
  CausticTask one = all;
  for (size_t l = 0; l < lights.size(); ++l) {
    if (!photonReaches(lights[l].shape, Receiver::Surface, Passage::Specular)) continue;
    all.lights.push_back(int(l));
    all.groups.push_back(relight.groupOf[l]);
    all.settings.path.nominal.push_back(relight.nominal[l]);
  }
  std::sort(all.groups.begin(), all.groups.end());
  all.groups.erase(std::unique(all.groups.begin(), all.groups.end()), all.groups.end());
  for (int l : all.lights) all.settings.path.groupOf.push_back(int(std::find(all.groups.begin(), all.groups.end(), relight.groupOf[l]) - all.groups.begin()));
  for (int g : all.groups) all.weights.push_back(relight.members[g].size() == 1 ? effective.gains[relight.members[g][0]] : Vec3(relight.scaleOf(g)));
  all.settings.path.groups = int(all.groups.size());
  std::vector<CausticTask> tasks;
  for (int l : all.lights) {
    if (effective.gainChanges[size_t(l)] == Vec3(0.0f) || relight.single(relight.groupOf[l])) continue;
    one.label = "caustics:difference:" + lights[l].name;
    one.lights = {l};
    one.groups = {relight.groupOf[l]};
    one.weights = {effective.gainChanges[size_t(l)]};
    one.settings.path.groups = 1;
    one.settings.path.groupOf = {0};
    one.settings.path.nominal = {Vec3(nominalScalar(lights[l]))};
    tasks.push_back(one);
  }
  tasks.insert(tasks.begin(), std::move(all));
  return tasks;
}

std::string causticNote(const CausticPlan& plan, uint32_t passes) {
  passes = (samplesOf(passes) + kBlockSamples - 1) / kBlockSamples;  // of photons: one a block
  char note[200];
  std::snprintf(note, sizeof note, "consistent, not unbiased: photons averaged over a radius of %.3g m in the first pass, %.3g m in the last of %u",
                double(plan.radius), double(causticRadius(plan.radius, std::max(passes, 1u) - 1)), passes);
  return note;
}

}  // namespace techniques
}  // namespace gobo

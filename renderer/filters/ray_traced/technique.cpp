// SPDX-License-Identifier: Apache-2.0
#include "filters/ray_traced/technique.h"

#include "base/sobol.h"
#include "filters/parameter.h"
#include "terms/visibility.h"

namespace gobo {
inline namespace filters {

uint64_t shadowSeed(const ShadowInput& input) {
  const std::string& name = input.scene->lights[input.light].name;
  return hash64(input.seed, hashBytes(name.data(), name.size()).lo);
}

namespace {

bool supports(LightKind kind) { return kind != LightKind::Environment; }

Result<NodeId> plan(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique) {
  const Light& light = input.scene->lights[input.light];
  if (!supports(light.shape.kind)) return invalidArgument("light '" + light.name + "' is an environment: it has no visibility term");
  VisibilitySettings s;
  // Hard shadows do not depend on the samples asked for or on the seed: one key for all.
  const bool hard = isDeltaLight(light.shape);
  s.samples = hard ? 1 : uint32_t(numberParameter(technique.ray_traced(), "samples"));
  s.seed = hard ? 0 : shadowSeed(input);
  if (input.clear) s.glass = Glass::Seen;
  s.extent = {input.width, input.height, input.viewSamples};
  s.place = input.place;
  return graph.add({makeVisibilityNode(s), {input.gbuffer}, {input.light}, "visibility:" + light.name, 0, input.scene, false});
}

}  // namespace

const ShadowTechniqueEntry& rayTracedShadowTechnique() {
  static const ShadowTechniqueEntry entry{v1::ShadowTechnique::kRayTraced, "ray_traced", supports, plan};
  return entry;
}

}  // namespace filters
}  // namespace gobo

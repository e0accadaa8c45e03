// SPDX-License-Identifier: Apache-2.0
// The shadow techniques that a request may name: one line each.
#include "filters/axis_aligned/technique.h"
#include "filters/ray_traced/technique.h"
#include "filters/shadow_map/techniques.h"
#include "filters/soft_shadow/techniques.h"

namespace gobo {
inline namespace filters {

namespace {
bool notAnEnvironment(LightKind kind) { return kind != LightKind::Environment; }
// plan/planner.cpp puts what chooseShadow (automatic/automatic.h) picks in its place before it plans.
Result<NodeId> chosenByThePlanner(Graph&, const ShadowInput&, const v1::ShadowTechnique&) { return internalError("shadows.auto was not resolved"); }
}  // namespace

const std::vector<ShadowTechniqueEntry>& shadowTechniques() {
  static const std::vector<ShadowTechniqueEntry> table{
      rayTracedShadowTechnique(),
      axisAlignedShadowTechnique(),
      {v1::ShadowTechnique::kShadowMap, "shadow_map", shadowMapSupports, planHardShadowMap, true},
      {v1::ShadowTechnique::kPercentageCloser, "percentage_closer", shadowMapSupports, planPercentageCloser, true},
      {v1::ShadowTechnique::kVariance, "variance", shadowMapSupports, planVarianceShadow, true},
      {v1::ShadowTechnique::kConvolution, "convolution", shadowMapSupports, planConvolutionShadow, true},
      {v1::ShadowTechnique::kExponential, "exponential", shadowMapSupports, planExponentialShadow, true},
      {v1::ShadowTechnique::kExponentialVariance, "exponential_variance", shadowMapSupports, planExponentialVarianceShadow, true},
      {v1::ShadowTechnique::kMoment, "moment", shadowMapSupports, planMomentShadow, true},
      {v1::ShadowTechnique::kPercentageCloserSoft, "percentage_closer_soft", softShadowSupports, planPercentageCloserSoft, true},
      {v1::ShadowTechnique::kConvolutionSoft, "convolution_soft", softShadowSupports, planConvolutionSoft, true},
      {v1::ShadowTechnique::kVarianceSoft, "variance_soft", softShadowSupports, planVarianceSoft, true},
      {v1::ShadowTechnique::kExponentialVarianceSoft, "exponential_variance_soft", softShadowSupports, planExponentialVarianceSoft, true},
      {v1::ShadowTechnique::kAuto, "auto", notAnEnvironment, chosenByThePlanner},
  };
  return table;
}

NodeId addShadowFilter(Graph& graph, NodePtr node, std::vector<NodeId> inputs, const std::string& what, const ShadowInput& input) {
  GraphNode n;
  n.node = std::move(node);
  n.inputs = std::move(inputs);
  n.label = what + ":" + input.scene->lights[size_t(input.light)].name;
  return graph.add(std::move(n));
}

Status checkShadowRange(const std::string& field, double value, double low, double high) {
  if (value >= low && value <= high) return {};
  return invalidArgument("shadows." + field + " = " + std::to_string(value) + ": must be in " + std::to_string(low) + " .. " + std::to_string(high),
                         "shadows." + field);
}

const ShadowTechniqueEntry* findShadowTechnique(v1::ShadowTechnique::TechniqueCase key) {
  for (const ShadowTechniqueEntry& e : shadowTechniques())
    if (e.key == key) return &e;
  return nullptr;
}

}  // namespace filters
}  // namespace gobo

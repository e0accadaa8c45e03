// SPDX-License-Identifier: Apache-2.0
#include "plan/denoised.h"

#include <algorithm>

#include "filters/composite.h"
#include "filters/denoise/denoise_node.h"
#include "filters/denoise/features.h"
#include "filters/denoise/noisy_picture.h"
#include "filters/denoise/registry.h"
#include "filters/expression.h"
#include "trace/sample_passes.h"

namespace gobo {

namespace {

/// Noise that denoisers know: of path tracing states, whose first half is a picture too. Lights that the camera sees have none but at their edges.
bool noisy(const Contribution& k) { return k.state >= 0 && !overlaps(k.paths, PathSet::Emission); }

}  // namespace

Result<NodeId> planSum(PlanContext& c, std::span<const Contribution> contributions, const std::string& label) {
  Expression e;
  std::vector<NodeId> inputs;
  int sum = -1;
  for (const Contribution& k : contributions) {
    auto at = std::find(inputs.begin(), inputs.end(), k.node);
    if (at == inputs.end()) at = inputs.insert(inputs.end(), k.node);
    const int plane = e.plane(int(at - inputs.begin()), k.plane);
    if (sum < 0) sum = e.constant(Vec3(0.0f));
    sum = e.multiplyAdd(sum, k.weight, plane);
  }
  if (sum < 0) e.constant(Vec3(0.0f));
  return c.filter(makeCompositeNode(std::move(e), c.view().width, c.view().height), std::move(inputs), label);
}

Result<NodeId> planDenoised(PlanContext& c, std::span<const Contribution> contributions, const std::string& label) {
  std::vector<Contribution> traced, others;
  for (const Contribution& k : contributions) (noisy(k) ? traced : others).push_back(k);
  GOBO_ASSIGN(const denoise::DenoiserPtr denoiser, denoise::makeDenoiser(c.request().denoise()));
  if (!denoiser || traced.empty()) return planSum(c, contributions, label);
  const int width = c.view().width, height = c.view().height;
  GOBO_ASSIGN(const NodeId all, planSum(c, traced, label + " traced"));
  // The first half goes first, and the whole goes on from it. A plan that only bounds is of one pass, and has a second picture of whatever count.
  const uint32_t samples = c.bounding() ? std::max(samplesOf(c.passes()), 2u) : samplesOf(c.passes());
  const uint32_t half = passesFor(samples / 2), first = samples > 1 ? samplesOf(half) : 0;
  const NodeId features = c.filter(denoise::makeFeaturesNode(width, height, c.view().viewSamples), {c.gbuffer(), c.surface()}, "features");
  std::vector<NodeId> inputs{features, all};
  if (samples > 1) inputs.insert(inputs.begin() + 1, c.atPasses(all, c.bounding() ? c.passes() + 1 : half));
  const NodeId picture = c.filter(denoise::makeNoisyPictureNode(width, height, samples, first), std::move(inputs), label + " in halves");
  const NodeId smooth = c.filter(denoise::makeDenoiseNode(denoiser, width, height, samples, first), {features, picture},
                                 label + " by " + denoiser->name());
  GraphNode modulated{denoise::makeModulateNode(width, height), {features, smooth}, {}, others.empty() ? label : label + " denoised"};
  modulated.approximate = "noise is taken out by " + std::string(denoiser->name()) + ", and with it what of the light looks like noise";
  const NodeId light = c.graph().add(std::move(modulated));
  if (others.empty()) return light;
  others.push_back({light, "rgb"});
  return planSum(c, others, label);
}

}  // namespace gobo

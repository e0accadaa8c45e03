// SPDX-License-Identifier: Apache-2.0
#include "plan/denoised.h"

#include <algorithm>

#include "filters/composite.h"
#include "filters/denoise/denoise_node.h"
#include "filters/denoise/features.h"
#include "filters/denoise/noisy_picture.h"
#include "filters/denoise/registry.h"
#include "filters/denoise/select/select.h"
#include "filters/expression.h"
#include "plan/outliers.h"
#include "request/request.h"
#include "trace/sample_passes.h"

namespace gobo {

namespace {

/// Noise that denoisers know: of path tracing states, whose first half is a picture too. Lights that the camera sees have none but at their edges.
bool noisy(const Contribution& k) { return k.state >= 0 && !overlaps(k.paths, PathSet::Emission); }

/// Filters that denoise.auto chooses from; without halves, by which they are judged, the first.
Result<std::vector<denoise::DenoiserPtr>> denoisersOf(const v1::Denoise& settings, bool halves) {
  std::vector<v1::Denoise> wanted(1, settings);
  if (settings.has_auto_()) {
    wanted.assign(halves ? settings.auto_().fast() ? 2 : 3 : 1, {});
    wanted[0].mutable_wavelet();
    if (wanted.size() > 1) wanted[1].mutable_non_local_means();
    if (wanted.size() > 2) wanted[2].mutable_first_order();
  }
  std::vector<denoise::DenoiserPtr> denoisers;
  for (v1::Denoise& d : wanted) {
    GOBO_TRY(resolveDefaults(d));
    GOBO_ASSIGN(denoise::DenoiserPtr made, denoise::makeDenoiser(d));
    if (made) denoisers.push_back(std::move(made));
  }
  return denoisers;
}

}  // namespace

namespace {

/// Adds the contributions to `sum` (-1: nothing yet).
void addTo(Expression& e, std::vector<NodeId>& inputs, int& sum, std::span<const Contribution> contributions) {
  for (const Contribution& k : contributions) {
    auto at = std::find(inputs.begin(), inputs.end(), k.node);
    if (at == inputs.end()) at = inputs.insert(inputs.end(), k.node);
    const int plane = e.plane(int(at - inputs.begin()), k.plane);
    if (sum < 0) sum = e.constant(Vec3(0.0f));
    sum = e.multiplyAdd(sum, k.weight, plane);
  }
}

}  // namespace

NodeId planSum(PlanContext& c, std::span<const Contribution> contributions, const std::string& label) {
  Expression e;
  std::vector<NodeId> inputs;
  int sum = -1;
  addTo(e, inputs, sum, contributions);
  if (sum < 0) e.constant(Vec3(0.0f));
  return c.filter(makeCompositeNode(std::move(e), c.view().width, c.view().height), std::move(inputs), label);
}

namespace {

/// What their sum `all` would be after so many passes. Where outliers are rejected, nodes say themselves what the samples of these are worth.
NodeId planFirst(PlanContext& c, std::span<const Contribution> traced, NodeId all, uint32_t passes) {
  std::vector<Contribution> earlier(traced.begin(), traced.end());
  bool said = false;
  for (Contribution& k : earlier) {
    if (c.graph().at(k.node).shape.find(kFirstSamples)) {
      k.plane = kFirstSamples;
      said = true;
    } else k.node = c.atPasses(k.node, passes);
  }
  if (!said) return c.atPasses(all, passes);
  return planSum(c, earlier, c.graph().at(all).label + ", its first samples");
}

}  // namespace

Result<NodeId> planDenoised(PlanContext& c, std::span<const Contribution> brought, const std::string& label) {
  // A plan that bounds what any count of samples holds is of one pass, and has a second picture of whatever count.
  const bool any = c.bounding() && c.passes() == 1 && c.request().halt().spp() != 1;
  const uint32_t samples = any ? 2 : samplesOf(c.passes());
  const uint32_t half = passesFor(samples / 2), first = samples > 1 ? samplesOf(half) : 0;
  GOBO_ASSIGN(const std::vector<denoise::DenoiserPtr> denoisers, denoisersOf(c.request().denoise(), samples > 1));
  std::vector<Contribution> contributions(brought.begin(), brought.end()), traced, others;
  if (c.request().denoise().has_outliers()) contributions = withoutOutliers(c, brought, label, first);
  for (const Contribution& k : contributions) (noisy(k) ? traced : others).push_back(k);
  if (denoisers.empty() || traced.empty()) return planSum(c, contributions, label);
  const int width = c.view().width, height = c.view().height;
  const NodeId all = planSum(c, traced, label + " traced");
  const NodeId features = c.filter(denoise::makeFeaturesNode(width, height, c.view().viewSamples), {c.gbuffer(), c.surface()}, "features");
  std::vector<NodeId> inputs{features, all};
  // The first half goes first, and the whole goes on from it.
  if (samples > 1) inputs.insert(inputs.begin() + 1, planFirst(c, traced, all, any ? c.passes() + 1 : half));
  const NodeId halves = c.filter(denoise::makeNoisyPictureNode(width, height, samples, first), std::move(inputs), label + " in halves");
  std::vector<NodeId> smooth;
  for (const denoise::DenoiserPtr& d : denoisers)
    smooth.push_back(c.filter(denoise::makeDenoiseNode(d, width, height, samples, first), {features, halves}, label + " by " + d->name()));
  if (smooth.size() > 1) {
    inputs.assign(1, halves);
    inputs.insert(inputs.end(), smooth.begin(), smooth.end());
    const float share = float(double(first) / double(samples));
    smooth.assign(1, c.filter(denoise::makeSelectNode(width, height, int(denoisers.size()), share), std::move(inputs), label + " selected"));
  }
  // Modulated again, and the rest. The filtered light is the first input, so that its first half is made first, of samples that are the others' too; what was
  // traced is the last, for the samples that it lost, of which filters know nothing.
  Expression e;
  inputs = {smooth[0], features};
  int sum = e.plane(0, "rgb");
  sum = e.multiply(sum, e.plane(1, "modulation"));
  addTo(e, inputs, sum, others);
  for (const Contribution& k : traced)
    if (std::find(inputs.begin(), inputs.end(), k.node) == inputs.end()) inputs.push_back(k.node);
  GraphNode picture{makeCompositeNode(std::move(e), width, height), std::move(inputs), {}, label};
  picture.approximate = "without noise, and without what of the light looks like it";
  return c.graph().add(std::move(picture));
}

}  // namespace gobo

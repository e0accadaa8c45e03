// SPDX-License-Identifier: Apache-2.0
#include "filters/axis_aligned/technique.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "filters/axis_aligned/filter.h"
#include "filters/axis_aligned/predicted_width.h"
#include "filters/axis_aligned/sample_count.h"
#include "filters/parameter.h"
#include "filters/ray_traced/technique.h"
#include "terms/shadow_slopes.h"

namespace gobo {
inline namespace filters {
namespace {

constexpr uint32_t kDefaultSamples = 16;  // where mean_samples is 0 and no equation says how many

bool supports(LightKind kind) { return kind == LightKind::Rect || kind == LightKind::Disk || kind == LightKind::Sphere || kind == LightKind::Directional; }

Result<NodeId> plan(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique) {
  const Light& light = input.scene->lights[input.light];
  if (!hasShadowLightFrame(light.shape))
    return invalidArgument("light '" + light.name +
                           "' is no rectangle, disk, sphere or directional light of some size: axis-aligned filtering needs a light plane");
  const v1::AxisAlignedShadow& m = technique.axis_aligned();
  auto number = [&](const char* name) { return numberParameter(m, name); };
  const Extent extent{input.width, input.height, input.viewSamples};
  const ShadowLightFrame frame = shadowLightFrame(light.shape);
  const uint64_t seed = shadowSeed(input);
  const int side = int(std::ceil(std::sqrt(number("pilot"))));
  const bool adaptive = boolParameter(m, "adaptive");
  const bool equation = adaptive && choiceParameter(m, "rate") == v1::AxisAlignedShadow::EQUATION;
  const bool predicted = choiceParameter(m, "width") == v1::AxisAlignedShadow::PREDICTED;
  const bool fourthOrder = choiceParameter(m, "kernel") == v1::AxisAlignedShadow::FOURTH_ORDER;
  const float mean = float(number("mean_samples"));
  const uint32_t samples = mean > 0.0f ? uint32_t(mean + 0.5f) : kDefaultSamples;

  ShadowRateSettings rate;
  rate.sigma = frame.sigma;
  rate.distant = frame.distant;
  rate.pilot = uint32_t(side * side);
  rate.maxSamples = uint32_t(number("max_samples"));
  if (!equation) rate.uniform = std::max(rate.pilot, samples);
  const uint32_t most = std::bit_ceil(equation ? std::max(rate.pilot, rate.maxSamples) : rate.uniform);  // the points are the same up to it

  auto source = [&](NodePtr node, std::vector<NodeId> inputs, const char* what) {
    return graph.add({std::move(node), std::move(inputs), {input.light}, what + (":" + light.name), 0, input.scene, false});
  };
  auto filter = [&](NodePtr node, std::vector<NodeId> inputs, const char* what) {
    return graph.add({std::move(node), std::move(inputs), {}, what + (":" + light.name), 0, nullptr, false});
  };
  const NodeId g = input.gbuffer;
  const int window = int(number("dilate_px"));
  const NodeId slopes = source(makeShadowSlopesNode({rate.pilot, most, equation, seed, extent, input.place, input.clear}), {g}, "shadow_slopes");

  const bool solve = equation && mean > 0.0f, bySlopes = equation || !predicted, byPenumbra = predicted || (adaptive && !equation);
  const NodeId dilated = bySlopes ? filter(makeShadowSlopeDilation(window, extent), {slopes, g}, "shadow_slope_dilation") : slopes;
  const NodeId penumbra = byPenumbra ? filter(makeShadowPenumbra(window, frame.sigma, extent), {slopes, g}, "shadow_penumbra") : slopes;
  const NodeId mu =
      filter(makeShadowMu(float(number("mu")), solve ? mean : 0.0f, rate), solve ? std::vector<NodeId>{dilated, g} : std::vector<NodeId>{}, "shadow_mu");
  const NodeId published = bySlopes || !adaptive ? filter(makeShadowSampleCount(rate, extent), {dilated, g, mu}, "shadow_sample_count") : NodeId(-1);
  const NodeId count =
      adaptive && !equation ? filter(makeShadowPenumbraCount(rate.pilot, rate.uniform, extent), {penumbra}, "shadow_penumbra_count") : published;
  const NodeId width = predicted ? filter(makeShadowPredictedWidth(fourthOrder, extent), {penumbra, g, count, mu}, "shadow_predicted_width") : published;
  const NodeId noisy = source(makeShadowAdaptiveNode({rate.pilot, most, seed, extent, input.place, input.clear}), {g, slopes, count}, "shadow_adaptive");

  AxisAlignedFilterSettings f;
  f.light = frame;
  f.k = float(number("k"));
  f.radiusPx = int(number("radius_px"));
  f.betaThreshold = float(number("beta_threshold"));
  f.angle = float(number("angle_deg") * M_PI / 180);
  f.fourthOrder = fourthOrder;
  return filter(makeAxisAlignedFilter(f), {noisy, g, width}, "axis_aligned_filter");
}

}  // namespace

const ShadowTechniqueEntry& axisAlignedShadowTechnique() {
  static const ShadowTechniqueEntry entry{v1::ShadowTechnique::kAxisAligned, "axis_aligned", supports, plan, false, hasShadowLightFrame};
  return entry;
}

}  // namespace filters
}  // namespace gobo

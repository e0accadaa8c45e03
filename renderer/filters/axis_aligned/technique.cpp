// SPDX-License-Identifier: Apache-2.0
#include "filters/axis_aligned/technique.h"

#include <algorithm>
#include <cmath>

#include "filters/axis_aligned/filter.h"
#include "filters/axis_aligned/sample_count.h"
#include "filters/parameter.h"
#include "filters/ray_traced/technique.h"
#include "terms/shadow_slopes.h"

namespace gobo {
namespace {

bool supports(LightKind kind) { return hasShadowLightFrame(kind); }

Result<NodeId> plan(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique) {
  const Light& light = input.scene->lights[input.light];
  if (!supports(light.shape.kind))
    return invalidArgument("light '" + light.name + "' is no rectangle, disk or sphere: axis-aligned filtering needs a light plane");
  const v1::AxisAlignedShadow& m = technique.axis_aligned();
  auto number = [&](const char* name) { return numberParameter(m, name); };
  const Extent extent{input.width, input.height, input.viewSamples};
  const ShadowLightFrame frame = shadowLightFrame(light.shape);
  const uint64_t seed = shadowSeed(input);
  const int side = int(std::ceil(std::sqrt(number("pilot"))));
  const bool adaptive = boolParameter(m, "adaptive");

  ShadowRateSettings rate;
  rate.sigma = frame.sigma;
  rate.pilot = uint32_t(side * side);
  rate.maxSamples = uint32_t(number("max_samples"));
  const float mean = float(number("mean_samples"));
  if (!adaptive) rate.uniform = std::max(rate.pilot, uint32_t(mean + 0.5f));

  auto source = [&](NodePtr node, std::vector<NodeId> inputs, const char* what) {
    return graph.add({std::move(node), std::move(inputs), {input.light}, what + (":" + light.name), 0, input.scene, false});
  };
  auto filter = [&](NodePtr node, std::vector<NodeId> inputs, const char* what) {
    return graph.add({std::move(node), std::move(inputs), {}, what + (":" + light.name), 0, nullptr, false});
  };
  const NodeId g = input.gbuffer;
  const NodeId slopes = source(makeShadowSlopesNode({rate.pilot, seed, extent, input.place, input.clear}), {g}, "shadow_slopes");
  const NodeId dilated = filter(makeShadowSlopeDilation(int(number("dilate_px")), extent), {slopes, g}, "shadow_slope_dilation");
  const bool solve = adaptive && mean > 0.0f;
  const NodeId mu =
      filter(makeShadowMu(float(number("mu")), solve ? mean : 0.0f, rate), solve ? std::vector<NodeId>{dilated, g} : std::vector<NodeId>{}, "shadow_mu");
  const NodeId count = filter(makeShadowSampleCount(rate, extent), {dilated, g, mu}, "shadow_sample_count");
  const NodeId noisy = source(makeShadowAdaptiveNode({rate.pilot, seed, extent, input.place, input.clear}), {g, slopes, count}, "shadow_adaptive");

  AxisAlignedFilterSettings f;
  f.light = frame;
  f.k = float(number("k"));
  f.radiusPx = int(number("radius_px"));
  f.betaThreshold = float(number("beta_threshold"));
  f.angle = float(number("angle_deg") * M_PI / 180);
  return filter(makeAxisAlignedFilter(f), {noisy, g, count}, "axis_aligned_filter");
}

}  // namespace

const ShadowTechniqueEntry& axisAlignedShadowTechnique() {
  static const ShadowTechniqueEntry entry{v1::ShadowTechnique::kAxisAligned, "axis_aligned", supports, plan};
  return entry;
}

}  // namespace gobo

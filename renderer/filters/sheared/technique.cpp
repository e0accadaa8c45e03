// SPDX-License-Identifier: Apache-2.0
#include "filters/sheared/technique.h"

#include <algorithm>
#include <bit>

#include "filters/axis_aligned/filter.h"
#include "filters/axis_aligned/predicted_width.h"
#include "filters/axis_aligned/sample_count.h"
#include "filters/ray_traced/technique.h"
#include "filters/sheared/shear.h"
#include "terms/shadow_light.h"
#include "terms/shadow_slopes.h"

namespace gobo {
inline namespace filters {

Result<LightSampleNodes> planLightSamples(Graph& graph, const ShadowInput& input, uint32_t pilot, uint32_t samples, int windowPx, bool keepSamples,
                                          const LightBands& bands) {
  const Light& light = input.scene->lights[size_t(input.light)];
  if (!hasLightRectangle(light.shape.kind)) return invalidArgument("light '" + light.name + "' is no rectangle: its samples have no places along two edges");
  if (input.clear) return invalidArgument("light passes some surfaces of the scene straight on: samples of the light are seen or not seen");
  const Extent extent{input.width, input.height, input.viewSamples};
  const uint32_t rays = std::max(pilot, samples), most = std::bit_ceil(rays);
  const float sigma = shadowLightFrame(light.shape).sigma;
  const uint64_t seed = shadowSeed(input);
  auto source = [&](NodePtr node, std::vector<NodeId> inputs, const char* what) {
    return graph.add({std::move(node), std::move(inputs), {input.light}, what + (":" + light.name), 0, input.scene, false});
  };
  const NodeId g = input.gbuffer;
  ShadowSlopesSettings slopes{pilot, most, false, seed, extent, input.place};
  slopes.keepBlocked = true;
  LightSampleNodes n;
  n.slopes = source(makeShadowSlopesNode(slopes), {g}, "shadow_slopes");
  n.penumbra = addShadowFilter(graph, makeShadowPenumbra(windowPx, sigma, extent), {n.slopes, g}, "shadow_penumbra", input);
  n.count = addShadowFilter(graph, makeShadowPenumbraCount(pilot, rays, extent), {n.penumbra}, "shadow_penumbra_count", input);
  const NodeId mu = addShadowFilter(graph, makeShadowMu(1.0f, 0.0f, {}), {}, "shadow_mu", input);
  n.width = addShadowFilter(graph, makeShadowPredictedWidth(true, extent), {n.penumbra, g, n.count, mu}, "shadow_predicted_width", input);
  LightSamplesSettings s;
  s.pilot = pilot;
  s.most = most;
  s.kept = (rays + 3) / 4 * 4;
  s.samples = keepSamples;
  s.bands = bands;
  s.seed = seed;
  s.extent = extent;
  s.place = input.place;
  n.samples = source(makeLightSamplesNode(s), {g, n.slopes, n.count}, "light_samples");
  return n;
}

Result<NodeId> planShearedShadow(Graph& graph, const ShadowInput& input, const ShearedShadowSettings& s) {
  GOBO_ASSIGN(const LightSampleNodes n, planLightSamples(graph, input, s.pilot, s.samples, s.windowPx, true, {}));
  const LightShape& shape = input.scene->lights[size_t(input.light)].shape;
  const Extent extent{input.width, input.height, input.viewSamples};
  AxisAlignedFilterSettings f;
  f.light = shadowLightFrame(shape);
  f.fourthOrder = true;
  const NodeId straight = addShadowFilter(graph, makeAxisAlignedFilter(f), {n.samples, input.gbuffer, n.width}, "axis_aligned_filter", input);
  ShearedFilterSettings c;
  c.light = lightRectangle(shape);
  c.radiusPx = s.radiusPx;
  c.passes = s.passes;
  ShadowShearSettings choice;
  choice.radiusPx = s.windowPx;
  choice.sigma = f.light.sigma;
  choice.half = std::min(c.light.halfU, c.light.halfV);
  choice.widestPx = s.radiusPx;
  choice.always = s.always;
  const NodeId shear = addShadowFilter(graph, makeShadowShear(choice, extent), {n.slopes, input.gbuffer, n.penumbra, n.count}, "shadow_shear", input);
  return addShadowFilter(graph, makeShearedFilter(c), {straight, input.gbuffer, n.samples, shear, n.count}, "sheared_filter", input);
}

}  // namespace filters
}  // namespace gobo

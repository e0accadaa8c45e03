// SPDX-License-Identifier: Apache-2.0
#include "filters/multiple_axis_aligned/technique.h"

#include "filters/axis_aligned/filter.h"
#include "filters/multiple_axis_aligned/bands.h"
#include "filters/sheared/technique.h"
#include "terms/shadow_light.h"

namespace gobo {
inline namespace filters {

Result<NodeId> planMultipleAxisAligned(Graph& graph, const ShadowInput& input, const MultipleAxisAlignedSettings& s) {
  GOBO_CHECK(s.bands.count() > 0 && s.scales.size() == s.bands.rims.size());
  GOBO_ASSIGN(const LightSampleNodes n, planLightSamples(graph, input, s.pilot, s.samples, s.windowPx, false, s.bands));
  AxisAlignedFilterSettings f;
  f.light = shadowLightFrame(input.scene->lights[size_t(input.light)].shape);
  f.radiusPx = s.radiusPx;
  f.fourthOrder = true;
  std::vector<NodeId> filtered;
  for (int j = 0; j < s.bands.count(); ++j) {
    f.k = 3.0f / s.scales[size_t(j)];
    const NodeId band = addShadowFilter(graph, makeLightBand(j), {n.samples}, "light_band", input);
    filtered.push_back(addShadowFilter(graph, makeAxisAlignedFilter(f), {band, input.gbuffer, n.width}, "axis_aligned_filter", input));
  }
  return addShadowFilter(graph, makeLightBandSum(), filtered, "light_band_sum", input);
}

}  // namespace filters
}  // namespace gobo

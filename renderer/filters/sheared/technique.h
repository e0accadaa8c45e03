// SPDX-License-Identifier: Apache-2.0
// Sheared filtering as a shadow technique, of rectangles. Not in the request schema: shadow_bench measures it beside the others.
//
//   gbuffer -> shadow_slopes (pilot rays) -> shadow_penumbra -+-> shadow_penumbra_count -> light_samples (rays) -> axis_aligned_filter -> sheared_filter -> V
//                                         |                   +-> shadow_predicted_width ------------------------^                        ^
//                                         +-> shadow_shear ------------------------------------------------------------------------------+
#pragma once

#include "filters/shadow_technique.h"
#include "filters/sheared/filter.h"

namespace gobo {
inline namespace filters {

struct ShearedShadowSettings {
  uint32_t samples = 16, pilot = 4;
  int windowPx = 10, radiusPx = 32;
  float always = 0.0f;  ///< as ShadowShearSettings
  ShearedFilterSettings::Passes passes = ShearedFilterSettings::Passes::Where;
};
/// As ShadowTechniqueEntry::plan. Errors: InvalidArgument for a light that is no rectangle and a scene that light passes straight on.
Result<NodeId> planShearedShadow(Graph& graph, const ShadowInput& input, const ShearedShadowSettings& settings);

/// What this technique and filters/multiple_axis_aligned have in common: pilot, rays and axis-aligned width, as shadows.axis_aligned with its defaults.
struct LightSampleNodes {
  NodeId slopes, penumbra, count, width, samples;
};
Result<LightSampleNodes> planLightSamples(Graph& graph, const ShadowInput& input, uint32_t pilot, uint32_t samples, int windowPx, bool keepSamples,
                                          const LightBands& bands);

}  // namespace filters
}  // namespace gobo

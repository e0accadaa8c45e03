// SPDX-License-Identifier: Apache-2.0
// Multiple axis-aligned filtering as a shadow technique, of rectangles. Not in the request schema: shadow_bench measures it beside the others.
//
//   gbuffer -> shadow_slopes -> shadow_penumbra -> ... -> light_samples -+-> light_band 0 -> axis_aligned_filter (3 / scale 0) -+-> light_band_sum -> V
//                                                                        +-> light_band 1 -> axis_aligned_filter (3 / scale 1) -+
#pragma once

#include "filters/shadow_technique.h"
#include "terms/light_samples.h"

namespace gobo {
inline namespace filters {

struct MultipleAxisAlignedSettings {
  uint32_t samples = 16, pilot = 4;
  int windowPx = 10, radiusPx = 32;
  LightBands bands{{1.0f, 0.0f}};
  std::vector<float> scales{1.2f, 1.0f};  ///< of a band's filter width, in those that shadows.axis_aligned predicts
};
/// As ShadowTechniqueEntry::plan. One band at scale 1 is shadows.axis_aligned with its defaults, but for rounding. Errors: those of planShearedShadow.
Result<NodeId> planMultipleAxisAligned(Graph& graph, const ShadowInput& input, const MultipleAxisAlignedSettings& settings);

}  // namespace filters
}  // namespace gobo

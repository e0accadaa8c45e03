// SPDX-License-Identifier: Apache-2.0
// Filter widths of least predicted error, and rays where there is a penumbra. Filters between the pilot and the adaptive rays, in the place of
// those of sample_count.h.
//
// Each pilot ray that an occluder of slope s stopped says that a penumbra of standard deviation S = sigma s is near. Squared bias grows
// with a power p near 4 of width / S (formulas/axis_aligned.glsl.h), so the mean of S^-4 over the pixels that a kernel reaches stands for all of
// them: one deep contact among a hundred soft occluders narrows the filter, but does not switch it off as the smallest slope would.
#pragma once

#include "terms/node.h"

namespace gobo {
inline namespace filters {

/// "shadow_penumbra". Inputs 0: "shadow_slopes", 1: "gbuffer". Planes: size f32, (mean of S^-4)^-1/4 in pixels over the view samples of the same
/// instance within +-radius pixels whose pilot met an occluder, S at least kNarrowestPenumbra; 0 where there are none, no surface, or one that none of the
/// pilot's points could shine on (its visibility is 1 by definition, and no neighbour's business). seen u8: 1 where the pilots within +-radius, of whatever
/// instance, met both an occluder and the light, or where none of the pilot's points could shine on the surface.
NodePtr makeShadowPenumbra(int radiusPx, float sigma, const Extent& extent);
inline constexpr float kNarrowestPenumbra = 0.25f;  ///< pixels: below it there is nothing that a filter may take together

/// "shadow_penumbra_count". Input 0: "shadow_penumbra". Plane n u32: `samples` where a penumbra was seen, `pilot` elsewhere.
NodePtr makeShadowPenumbraCount(uint32_t pilot, uint32_t samples, const Extent& extent);

/// "shadow_predicted_width". Inputs 0: "shadow_penumbra", 1: "gbuffer", 2: a term with plane n u32, 3: "shadow_mu". Plane Omega f32, rad/m: what makes the
/// filter of k = 3 as wide as formulas::aaPredictedWidth / filterMu; 0 where there is nothing to filter.
NodePtr makeShadowPredictedWidth(bool fourthOrder, const Extent& extent);

}  // namespace filters
}  // namespace gobo

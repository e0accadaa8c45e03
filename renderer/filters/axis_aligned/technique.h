// SPDX-License-Identifier: Apache-2.0
// Axis-aligned filtering as a shadow technique. Rectangles, disks, spheres, and directional lights of some size (suns, and the
// rectangles at infinity that stand for an environment); point-like, mesh and environment lights have no light plane.
//
//   gbuffer -> shadow_slopes (pilot rays) -> shadow_penumbra -+-> shadow_penumbra_count -> shadow_adaptive (rays) -> filter -> V
//                                                             +-> shadow_predicted_width -------------------------^
//   rate = EQUATION, width = BAND_LIMIT:    -> dilation -+-> shadow_mu -> sample_count -> shadow_adaptive -> filter -> V
//
// An edit of radius or thresholds re-runs the filter alone; of k too; of mu the widths and the filter (with EQUATION the counts and rays too); of
// dilate_px all but the pilot; of pilot, seed, mean_samples (with EQUATION: max_samples) beyond a power of two, which deals the points out anew, all.
#pragma once

#include "filters/shadow_technique.h"

namespace gobo {
inline namespace filters {

const ShadowTechniqueEntry& axisAlignedShadowTechnique();

}  // namespace filters
}  // namespace gobo

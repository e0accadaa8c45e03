// SPDX-License-Identifier: Apache-2.0
// Axis-aligned filtering as a shadow technique. Rectangles, disks and spheres; point-like, mesh and environment lights have no light plane.
//
//   gbuffer -> shadow_slopes (pilot rays) -> dilation -+-> shadow_mu -> sample_count -> shadow_adaptive (rays) -> filter -> V
//
// An edit of k, radius or thresholds re-runs the filter alone; of mu, max_samples or mean_samples everything from shadow_mu on; of dilate_px
// the same; of pilot or seed all. adaptive = false: mean_samples rays everywhere (the pilot's where that is 0 or less than them), mu as given.
#pragma once

#include "filters/shadow_technique.h"

namespace gobo {

const ShadowTechniqueEntry& axisAlignedShadowTechnique();

}  // namespace gobo

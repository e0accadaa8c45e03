// SPDX-License-Identifier: Apache-2.0
// The passive steps between the pilot and the adaptive rays: spreading slopes, choosing mu, counting rays. All are filters: they see terms
// only. mu travels as a term of its own, so that an edit of mu re-runs the counts and what is behind them, not the pilot, and the filter
// gets the realised mu inside Omega.
#pragma once

#include "terms/node.h"
#include "terms/shadow_light.h"

namespace gobo {
inline namespace filters {

/// "shadow_slope_dilation". Inputs 0: "shadow_slopes", 1: "gbuffer". A view sample whose pilot met no occluder takes the largest sMax and the
/// smallest sMin of view samples of the same instance within +-radius pixels (rows, then columns); one that met an occluder keeps its own.
/// Planes sMax, sMin f32 (0: no occluder near, visibility is 1 and stays so). O(radius) per pixel.
NodePtr makeShadowSlopeDilation(int radiusPx, const Extent& extent);

struct ShadowRateSettings {
  float sigma = 1.0f;  ///< standard deviation of the light, metres; distant: its tangent (terms/shadow_light.h)
  uint32_t pilot = 9, maxSamples = 256;
  uint32_t uniform = 0;  ///< not 0: this many rays everywhere instead of the adaptive rate
  bool distant = false;  ///< slopes are distances, metres
  bool printed = false;  ///< literal mode: equation 3.5 as printed, without the cap
};

/// "shadow_mu". A Table of one element: planes "mu" (ray counts) and "filterMu" (filter widths). With meanSamples = 0: both are `mu`, no
/// inputs. Otherwise filterMu = max(mu, 1), because a small budget is better spent as fewer rays under a filter at the band limit than under
/// one wider than it (which blurs what the light lets through), and inputs 0: dilated slopes,
/// 1: "gbuffer", and mu in [0.25, 64] is bisected until the mean count over view samples that hit something is meanSamples (the nearer end
/// where no mu reaches it). Every eighth view sample takes part from 65536 on.
NodePtr makeShadowMu(float mu, float meanSamples, const ShadowRateSettings& rate);

/// "shadow_sample_count". Inputs 0: dilated slopes, 1: "gbuffer", 2: "shadow_mu".
/// Planes n u32: shadow rays per view sample (0 for background), the capped equation 3.5 rounded and limited to [pilot, maxSamples];
/// Omega f32: band limit in rad/m at filterMu, 0 where there is nothing to filter.
NodePtr makeShadowSampleCount(const ShadowRateSettings& rate, const Extent& extent);

}  // namespace filters
}  // namespace gobo

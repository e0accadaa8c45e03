// SPDX-License-Identifier: Apache-2.0
// The two sources of axis-aligned shadow filtering: a sparse pilot that finds the occluders' slopes, and the adaptive pass that
// spends the rays that the slopes ask for (Wang, UCB/EECS-2013-118, passes 1 and 2). Area lights with a plane only (terms/shadow_light.h).
// Points come from a ScreenSequence: the pilot takes the first `pilot` of a view sample's, the adaptive pass goes on from there, so no pilot
// ray is wasted and the union is as well spread as any prefix; and those of neighbours are spread well together, for the filter that follows.
#pragma once

#include "terms/node.h"
#include "terms/shadow_light_profile.h"
#include "terms/view_place.h"

namespace gobo {
inline namespace terms {

struct ShadowSlopesSettings {
  uint32_t pilot = 9;    ///< rays per view sample
  uint32_t most = 9;     ///< the most rays that a view sample may get in all
  bool bothEnds = true;  ///< sMax is asked for
  uint64_t seed = 0;
  Extent extent;
  ViewPlace place;
  bool clear = false;  ///< light passes some surfaces straight on (trace/straight.h): sumV has three channels
  ShadowLightProfile profile;
  bool keepBlocked = false;  ///< a plane more: blocked u32, bit i set where ray i (of the first 32) met an occluder or went into the surface
};
/// Source "shadow_slopes". Input 0: "gbuffer". Per ray one closest hit from the receiver and, if it is blocked and `bothEnds`, one back from the light.
/// Planes: sMax f32 largest (without bothEnds: of the occluders nearest to the receiver) and sMin f32 smallest slope t/(T-t) of the occluders seen
/// (formulas/axis_aligned.glsl.h; of a light at infinity the occluder's distance along its axis, metres: terms/shadow_light.h), 0 where none; (tinted panes
/// among them: their edges have penumbras too); sumV, sumW f32 weighted sum of visibility and of weights over the pilot points; occluded u8.
NodePtr makeShadowSlopesNode(const ShadowSlopesSettings& settings);

struct ShadowAdaptiveSettings {
  uint32_t pilot = 9;  ///< as the pilot's
  uint32_t most = 9;   ///< as the pilot's
  uint64_t seed = 0;   ///< as the pilot's
  Extent extent;
  ViewPlace place;
  bool clear = false;          ///< as the pilot's: V has three channels
  ShadowLightProfile profile;  ///< as the pilot's
};
/// Source "shadow_adaptive". Inputs 0: "gbuffer", 1: "shadow_slopes", 2: a term with plane n u32, rays per view sample in all.
/// Term "visibility", plane V f32: the unfiltered estimate over n points (terms/visibility.h has the meaning and the cases that give 1).
NodePtr makeShadowAdaptiveNode(const ShadowAdaptiveSettings& settings);

}  // namespace terms
}  // namespace gobo

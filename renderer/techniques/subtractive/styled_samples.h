// SPDX-License-Identifier: Apache-2.0
// Subtractive samples of a map whose few lights have visibility terms of their own (a style, filters/stylised), in the place of shadow rays: one filter made of
// two. Term, planes and traced samples as "subtractive_samples" (samples.h), of which this is one; with visibility of 0 and 1 that rays found, to the bit.
// A fold: after the G-buffer and the surface one visibility ("V", one channel, 0 .. 1) for each light, in their order, looked up at the traced
// samples; nobody holds two of them. What is traced by nobody here has been traced at full resolution, which is what distances to contours are made of.
// Cost: for each light and traced sample a look at the material, 0.3 us. Memory: 136 bytes a traced sample.
#pragma once

#include "technique/plan_context.h"
#include "techniques/subtractive/samples.h"

namespace gobo::subtractive {

NodePtr makeStyledSamplesNode(const SamplesSettings& settings);

/// Visibility of these lights by `technique`, which has a style, of the light that requests know as "environment", and their samples. Visibilities are kept
/// while all of them take up at most 256 MB, else made again where they are asked for again.
Result<NodeId> planStyledSamples(PlanContext& context, const SamplesSettings& settings, v1::ShadowTechnique technique);

}  // namespace gobo::subtractive

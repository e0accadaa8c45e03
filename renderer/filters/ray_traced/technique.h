// SPDX-License-Identifier: Apache-2.0
// Ray-traced visibility as a shadow technique: one node, terms/visibility.h. Every light kind but Environment.
#pragma once

#include "filters/shadow_technique.h"

namespace gobo {
inline namespace filters {

const ShadowTechniqueEntry& rayTracedShadowTechnique();

/// The sample seed of a light: the request's, mixed with the light's name, so that two lights at one pixel draw apart and a light
/// keeps its samples when others come and go.
uint64_t shadowSeed(const ShadowInput& input);

}  // namespace filters
}  // namespace gobo

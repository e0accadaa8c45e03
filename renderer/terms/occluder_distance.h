// SPDX-License-Identifier: Apache-2.0
// How far from a shadow's edge what casts it is: a ray from each view sample in shadow that has a neighbour in the light, towards the light.
// Inputs: 0 "gbuffer"; 1 a visibility term (plane V, 1 or 3 channels, hard at 1/2). The light is the one in the graph node's `lights`; any kind but
// Environment: of a light of some size its centre. Term "occluder_distance", domain ViewSample, planes d f32: metres to the first surface on the way, -1 where
// no ray was traced or nothing is met (also a surface that is turned away), and instance u32: whose surface it is, ~0u where there is none. Clear surfaces
// count as others. Cost: one ray for each sample at an edge, which is a few in a hundred.
#pragma once

#include "terms/node.h"

namespace gobo {
inline namespace terms {

NodePtr makeOccluderDistanceNode(const Extent& extent);

}  // namespace terms
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Depth peeling by rays: what each view sample would see next if the surface that it sees were not there.
//
// Computes     Of each view sample of the input that hit something, the next surface along the same ray that faces the camera: its triangle's outside by the
//              winding. Insides of closed bodies, which nothing lights, are passed. What a G-buffer says of a hit, but for texture coordinates.
// Input        0: a "gbuffer" of the view, or the term of this node for the surface before: planes P, Ng, depth, instance.
// Output       term "hidden_surface", domain ViewSample: P f32x3, N f32x3, Ng f32x3 (towards the viewer), depth f32 (+inf), instance u32 (~0u), footprint f32,
//              zeros where there is no such surface.
// Error        The way on begins where the hit was, moved off by offsetOrigin (trace/accel.h): surfaces nearer to each other than some ulp are one.
// Fails where  an open sheet is wound the other way than it is seen: from behind it is passed. More than kMostPassed insides in a row end the search.
// Cost         A ray a sample and one more for each surface passed. Packets of 16 along the film's rows.
#pragma once

#include "terms/gbuffer.h"

namespace gobo {
inline namespace terms {

inline constexpr int kMostPassed = 64;

NodePtr makeHiddenSurfaceNode(const GBufferSettings& view);

}  // namespace terms
}  // namespace gobo

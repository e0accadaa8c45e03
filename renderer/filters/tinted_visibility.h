// SPDX-License-Identifier: Apache-2.0
// Shadow maps see solid surfaces only; what clear panes, tinted glass and boundaries of index 1 leave of the light comes from rays.
//
// Computes     V'(x) = V(x) T(x), by channel: V the share of the light that solid surfaces leave, T the mean of what clear ones leave
//              of it (terms/visibility.h, Glass::Alone).
// Inputs       0: term "visibility", plane V (1 channel); 1: term "visibility", plane V (3 channels).
// Output       term "visibility", plane V (3 channels), and plane flags of input 0 if it has one.
// Error        None for lights that are a point. For area lights the mean of a product is taken for the product of the means: at the
//              edges of panes whose own penumbra crosses one of a solid.
// Cost         12 bytes an element written, 16 read.
#pragma once

#include "filters/shadow_technique.h"

namespace gobo {
inline namespace filters {

NodePtr makeTintedVisibilityNode(const Extent& extent);

/// Adds the rays through clear surfaces and the product behind a map's visibility `v`; `v` itself where the scene has none.
NodeId planTint(Graph& graph, const ShadowInput& input, NodeId v);

}  // namespace filters
}  // namespace gobo

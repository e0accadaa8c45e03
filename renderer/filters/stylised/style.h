// SPDX-License-Identifier: Apache-2.0
// A style for the shadow of one light, whatever technique made its visibility: distance to the contour, its shape (elongation, target), abstraction, what
// `keep` leaves of deflation, transfer, each a node of its own that is planned where it is asked for, so that an edit of inflation, softness or brightness
// (their formulas too) runs the transfer alone, abstraction that and the blur, a shape's field the shape too, power, norm and angle the distance too
// (docs/intent.md).
#pragma once

#include "filters/shadow_technique.h"
#include "filters/stylised/style_formulas.h"

namespace gobo {
inline namespace filters {

/// `v`: term with plane V. `formulas`: of fields that vary from place to place. Returns the node whose term has the styled V of as many channels.
NodeId planStyle(Graph& graph, const ShadowInput& input, NodeId v, const v1::ShadowStyle& style, const StyleFormulas& formulas = {});

/// The distance that the transfer of a styled visibility (or a window of it) reads, abstraction and all: a node with plane D, metres, negative in shadow, 1e30
/// where there is no contour. Of several levels that of the middle one. Errors: InvalidArgument: the light has no style.
Result<NodeId> planStyleDistance(Graph& graph, NodeId styled);

}  // namespace filters
}  // namespace gobo

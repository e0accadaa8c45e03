// SPDX-License-Identifier: Apache-2.0
// Mean of the styled shadows of a soft visibility's levels (ShadowStyle.levels).
//
// Computes     S(x) = 1/K sum_k S_k(x), S_k the style of the hard shadow V < (k + 1/2) / K (filters/stylised/contour.h). Of a neutral style it is V in K steps,
// and V as K grows; of
//              visibility that is 0 or 1 it has the bits of one level for any K.
// Inputs       0, for coloured visibility alone: plane V of 3 channels; then K terms with plane V of one.
// Output       term "visibility", plane V, of as many channels as the first. Of three: S times V over its largest channel where any level is lit, and S itself
// elsewhere: levels say how
//              much light there is, V what colour it has.
// Numerics     Sums in double: equal S_k give back their bits.
// Cost         A fold: one S_k is there at a time. 8 bytes an element and a pass over each.
#pragma once

#include "terms/node.h"

namespace gobo {
inline namespace filters {

/// `levels` at least 1.
NodePtr makeStyleLevelsNode(const Extent& extent, int levels, bool coloured);

}  // namespace filters
}  // namespace gobo

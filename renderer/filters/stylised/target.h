// SPDX-License-Identifier: Apache-2.0
// Target of a shadow: the way from its own outline to a simple shape, piece by piece.
//
// Computes     D'(x) = (1 - t) D(x) + t T(x), T the signed distance in the world to the nearest target of a piece of shadow (filters/stylised/pieces.h),
// positive
//              outside: the least over those whose normal is within `angle` of x's, and over the piece that x itself lies in.
// Effect       t = 1: each piece is an ellipse, a rectangle or between (angularity) of its own area, place, axes and ratio of widths; what has that shape
// already
//              keeps its outline. Shapes that overlap are one shadow.
// Inputs       0: plane D (filters/stylised/distance_field.h), elongation and all: pieces are where D < 0. 1: "gbuffer" (P, N, Ng, instance, footprint).
// Output       term "style_distance", plane D, never 0. D stays where it is +-1e30 (no contour is seen) and where no target is.
// Parameters   target 0 .. 1: 0 copies, plans leave it out; angularity 0 .. 1.
// Units        T is in metres, whatever norm D has: between 0 and 1 a PUBLISHED distance is mixed with one in metres, and the outline alone says how far.
// Cost         Links, labels and sums on one thread a layer, some 100 ns a sample; then 60 to 250 ns a sample for each target that may be the nearest one: two
// or
//              three where pieces lie apart. Targets are sought by squares of 16 x 16 samples: a nanosecond for each of them and piece.
// Fails where  receivers bend: a target is flat, in the plane of its piece's mean normal, and what curves away from it is cut by its shadow along the normal.
// Determinism  bit-identical for any number of threads. No windows: pieces are of the whole picture, cut at its border.
#pragma once

#include "terms/node.h"

namespace gobo {
inline namespace filters {

struct StyleTargetSettings {
  Extent extent;
  float target = 0, angularity = 0;
  float angle = 0.78539816f;  ///< radians
};

NodePtr makeStyleTargetNode(const StyleTargetSettings& settings);

}  // namespace filters
}  // namespace gobo

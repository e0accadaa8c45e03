// SPDX-License-Identifier: Apache-2.0
// Half width of a shadow along its skeleton, and a distance that keeps a share of it where the shadow is deflated (ShadowStyle.keep).
//
// style_half_width
//   Computes   Plane half_width: the distance r(y) in the world from each sample y of the shadow's skeleton to its edge, 0 elsewhere
//              (filters/stylised/skeleton.h).
//   Inputs     0: plane D (filters/stylised/distance_field.h), abstraction and all; 1: "gbuffer" (P, N, Ng, instance, footprint).
//   Output     term "style_half_width", plane half_width f32, metres.
//
// style_keep
//   Computes   D'(x) = min(D(x), i + w(y) (|x - y| / r(y) - k)),  w = -D(y),  where i(x) < 0, y being that of the thin samples about which the disc of radius
//              k r(y) is nearest to x;  D' = D elsewhere. A sample y of the skeleton is thin where (1 - k) w(y) < -i(y): deflation alone would leave less of
//              it than k.
//   Effect     {D' < i} is what deflation leaves, joined with discs of radius k r(y) about the skeleton where that is thin: the medial axis transform of the
//              shadow with radii max(r - |i|, k r). So thin parts keep the share k of their half width and stay as connected as the shadow was, wherever k r is
//              more than a pixel; parts that are not thin have D to the bit. At the former edge both are 0: softness sees no seam.
//   Why w / r  D is not the distance itself: between two parallel edges the averaged one is 2^(-1/(p-1)) of it (0.91 for p = 8), PUBLISHED has no unit at all.
//   In
//              units of D at y, on the skeleton alone, k is a share of the width whatever D measures.
//   Inputs     0: plane D; 1: plane half_width; 2: "gbuffer"; 3, where the inflation varies: "style_parameters" (plane inflation).
//   Output     term "style_distance", plane D, at most that of input 0.
//   Parameters keep k 0 .. 1; inflation i. i >= 0 copies; plans leave it out. k = 0 copies too.
//   Error      Which y is nearest is found by sweeps over linked samples (filters/stylised/surface_links.h): exact but for fractions of a pixel. Where an even
//              number of samples lies across a part, its skeleton is two of them wide and keeps up to half a pixel more. Ends of thin parts draw in by (1 - k)
//              of their half width. Samples that no link joins with a thin y keep D: light behind a gap.
// Cost         style_half_width 30 to 60 ns a sample and 200 ns a shadowed one; style_keep 40 to 100 ns a sample.
// Determinism  bit-identical for any number of threads. No windows: skeletons go through the picture.
#pragma once

#include "terms/node.h"

namespace gobo {
inline namespace filters {

struct StyleHalfWidthSettings {
  Extent extent;
  float angle = 0.78539816f;  ///< radians
};
NodePtr makeStyleHalfWidthNode(const StyleHalfWidthSettings& settings);

struct StyleKeepSettings {
  Extent extent;
  float angle = 0.78539816f;
  float keep = 0, inflation = 0;
  bool varies = false;  ///< inflation
};
NodePtr makeStyleKeepNode(const StyleKeepSettings& settings);

}  // namespace filters
}  // namespace gobo

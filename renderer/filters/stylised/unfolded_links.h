// SPDX-License-Identifier: Apache-2.0
// Which neighbouring view samples lie on one stretch of surface, and how far it is from one to the next along it: the graph that distances along surfaces are
// measured on (filters/stylised/surface_march.h).
//
// Linked       Two neighbours e, f that hit something, where
//              a plane    each lies within a pixel's width (plane footprint) of the other's tangent plane and their normals differ by at most the angle:
//              however
//                         grazing the plane is seen, and whatever instances meet in it;
//              a crease   or they are at most kCreaseReach widths apart and each lies on the same side of the other's tangent plane: both in front of it where
//                         walls meet, both behind it at the edge of a box. Where one thing is seen beyond the silhouette of another, what is behind lies behind
//                         the tangent plane of what is in front and not the other way round: a step in depth links nothing.
//              Diagonal neighbours are linked if, besides, one of the two samples between them is linked with both: a surface does not go on through a thin
//              gap.
// Length       Straight between samples whose normals are alike; around a crease that of the unfolded planes: of distances a, b to the line where they meet and
// s
//              along it, sqrt((a + b)^2 + s^2).
// Fails where  something hangs less than a pixel's width over a surface, or stands behind a silhouette that is seen edge-on by less than kCreaseReach widths:
// they
//              are linked. A crease seen under less than about 4 degrees is not.
// Cost         Four tests a sample, some 30 ns; a byte a sample.
#pragma once

#include <vector>

#include "filters/stylised/surface_links.h"

namespace gobo {
inline namespace filters {

inline constexpr float kCreaseReach = 16.0f;  ///< of a pixel's width

/// Whether samples e and f, which are neighbours, are linked as sides of pixels are (no diagonal's condition). Symmetric.
bool onOneStretch(const ContourInput& in, size_t e, size_t f, float cosine);
/// Along the surface between linked samples; in double, positive unless they are one point.
double surfaceStep(const ContourInput& in, size_t e, size_t f);
/// Of each sample a bit for each neighbour (kAround) that it is linked with. Errors: Cancelled.
Result<std::vector<uint8_t>> surfaceLinks(const ContourInput& in, float cosine, const TaskArena& arena, const StopToken& stop);

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Distance to a contour along the surfaces that a layer of view samples shows (geodesic distance on the graph of filters/stylised/unfolded_links.h).
//
// Computes     At every sample the length of the shortest way over linked samples to the contour: exactly, to the nearest segment itself, as long as that is
// seen
//              straight over what is flat, and by fast marching (Kimmel, Sethian 1998, Computing geodesic paths on manifolds) from there on: around corners and
//              gaps, over curved surfaces.
//              Straight: a sample takes a segment over from two linked neighbours that have theirs so, if the way to it runs between the two and the segment
//              lies in the sample's tangent plane (5 % of the distance: an arc of 0.1 radians, whose chord is 4e-4 shorter). Each of the two hands on how much
//              of its own way is free, by how near the way passes (from half of it on a segment counts as seen): holes and gaps have nothing to hand on. From
//              that segment it goes down along the contour to the nearest one. Marching: of a triangle of linked neighbours with distances at two corners the
//              third's by a straight front, where that comes from between them; else along a side.
// Why not heat The heat method (Crane, Weischedel, Wardetzky 2013) on the same graph errs by a step or two next to the contour, where styles are seen most,
// rounds
//              where two fronts meet, and solves two systems of as many unknowns as there are samples.
// Error        Flat and in sight of the contour: that of the contour. Beyond: straight fronts keep their distances; about a corner that a front bends around a
// step
//              h of the grid makes h / 8 ln(r / h) too much at distance r, under 1 % from 10 steps on (docs/intent.md has what was measured). Beside the border
//              of the picture or of a surface, where some of a sample's neighbours are missing, up to a step more.
// Cost         A heap and some 8 updates a sample, about 3 us, by one thread a layer; 29 bytes a sample.
// Determinism  One thread marches one layer in one order: ties go by place.
#pragma once

#include <span>
#include <vector>

#include "filters/stylised/contour.h"

namespace gobo {
inline namespace filters {

/// `links`: surfaceLinks(in). `contour`, `squares`: extractContour(in). D of each sample: at least 0, infinite where no contour can be reached. Errors:
/// Cancelled.
Result<std::vector<double>> marchSurface(const ContourInput& in, std::span<const uint8_t> links, std::span<const ContourSegment> contour,
                                         std::span<const uint32_t> squares, float cosine, const StopToken& stop);

/// Bytes a sample that it holds at once, its result among them.
inline constexpr size_t kMarchBytes = 8 + 5 * 4 + 1;

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Pieces of a shadow, and the simple shape of each: its target (ShadowStyle.target, angularity).
//
// Computes     Pieces: shadowed samples (D < 0) connected by surface links to any of eight neighbours (filters/stylised/surface_links.h), numbered by their
// first
//              sample in raster order. Each sample stands for a parallelogram of the surface, halves of the steps to its linked neighbours; a piece's area,
//              centroid and mean normal are the sums over them, its second moments those in the plane through the centroid, with each parallelogram's own (a
//              twelfth of its steps squared), so that a rectangle of whole pixels has its own to rounding. The target has that centroid and area, the ratio of
//              standard deviations, and their axes; where these differ by less than 2 % and the shape is no ellipse, the axes of the fourth moment, which a
//              square has and a disc has not.
// Left out     Pieces without an area (all samples in one place): they have no target.
// Numerics     double, in raster order on one thread: the same bits always. Deviations are at least a millionth of the other's, so that lines have shapes.
// Cost         Some 40 ns a sample for links and labels, 30 ns a shadowed one for sums.
#pragma once

#include "filters/stylised/surface_links.h"
#include "filters/stylised/target_shape.h"

namespace gobo {
inline namespace filters {

struct ShadowPiece {
  TargetShape shape;
  DVec3 centre{0.0};
  Vec3 normal{0.0f};     ///< unit
  DVec3 u{0.0}, v{0.0};  ///< unit, across the normal: axes of the shape
  double area = 0;
  double thickness = 0;  ///< of the surface about the centroid's plane, and a pixel's width: what is within it lies in the piece's plane
  size_t samples = 0;
  bool whole = false;  ///< has a target
  /// Of a ball around the centre: the distance to the target is no less than that to the ball.
  double reach() const { return shape.reach() + thickness; }
};

struct ShadowPieces {
  static constexpr uint32_t kNone = ~0u;
  std::vector<uint32_t> label;  ///< of each sample: index into pieces, or kNone in light
  std::vector<ShadowPiece> pieces;
};

/// Of one layer. Errors: Cancelled.
Result<ShadowPieces> shadowPieces(const ContourInput& in, const SurfaceLinks& links, std::span<const float> D, double angularity, const StopToken& stop);

/// Signed distance from x to a piece's target in the world: within `thickness` of its plane that in the plane, elsewhere that to the flat shape, positive.
double distanceToTarget(const ShadowPiece& piece, const DVec3& x);

}  // namespace filters
}  // namespace gobo

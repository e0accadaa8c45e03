// SPDX-License-Identifier: Apache-2.0
// Contour of a hard shadow, in the world: marching squares over the centres of view samples.
//
// Computes     Of each square of four neighbouring samples whose visibility lies on both sides of 1/2 the segments that part them. Their ends lie on the
// receivers,
//              between two neighbours at the place where visibility, taken for linear, is 1/2: half way for hard visibility. Length is that in the world, so a
//              diagonal is no staircase and stretches far from the eye count as long as they are. Where two shadowed samples face each other diagonally
//              (V = 0 1 / 1 0) they are connected: thin shadows stay whole.
// Cut          What ends a shadow in the picture and not on the surface is no contour: two neighbours must have hit the same instance, their normals differ by
// at
//              most `angle`, and each lie within one pixel's width (plane footprint) of the other's tangent plane. The last holds on a plane however
//              grazing it is seen and fails at a step in depth; samples that hit nothing belong to no contour.
// Levels       Of soft visibility also the contours of other levels than 1/2. A step from 0 to 1 between neighbours says nothing of where in between it is: the
// edge is half way for every
//              level, and the steeper a step is above 1/2, the less it is taken for linear. Contours of several levels neither cross nor swap, and those of
//              hard visibility are one.
// Inputs       One layer of a visibility term (1 or 3 channels: of three the largest counts, so that tinted light is light) and of a G-buffer.
// Attached     Surfaces that are turned away from the light are lit in Gobo's visibility (terms/visibility.h): there is no attached shadow that inflation would
//              spread. Where a cast shadow runs over the terminator of a smooth body there is a contour along it that is none.
// Fails where  the picture's border cuts a shadow: the contour ends there, at the centres of the outermost samples. Samples across a silhouette hide what lies
//              between: the contour ends up to a pixel short of it.
// Cost         One pass, some 3 ns a sample. At most two segments a square, 36 bytes each.
// Determinism  Segments by rows of the picture, whatever the number of threads.
#pragma once

#include <algorithm>
#include <span>
#include <vector>

#include "base/status.h"
#include "base/task_arena.h"
#include "base/vec.h"

namespace gobo {
inline namespace terms {
class Term;
}
}  // namespace gobo

namespace gobo {
inline namespace filters {

struct ContourSegment {
  Vec3 a{0.0f}, b{0.0f};
  Vec3 normal{0.0f};  ///< of the receiver, unit: mean of the samples that the segment parts
};

/// One layer: spans of width * height samples, row by row.
struct ContourInput {
  int width = 0, height = 0, channels = 1;
  std::span<const float> V, P, N, Ng, footprint;
  std::span<const uint32_t> instance;
  float level = 0.5f;    ///< of visibility, which is light from it on
  bool several = false;  ///< of several levels: hard steps are half way for each

  bool valid(size_t e) const { return instance[e] != ~0u; }
  float visibility(size_t e) const { return channels == 1 ? V[e] : std::max({V[3 * e], V[3 * e + 1], V[3 * e + 2]}); }
  bool lit(size_t e) const { return visibility(e) >= level; }
  Vec3 at(std::span<const float> plane, size_t e) const { return Vec3(plane[3 * e], plane[3 * e + 1], plane[3 * e + 2]); }
};

/// One layer of a "gbuffer", which must outlive it: no V.
ContourInput surfaceInput(const Term& gbuffer, size_t layer);
/// The same with that of a visibility term (plane V). `level`: of `levels`, the middle of its step.
ContourInput contourInput(const Term& visibility, const Term& gbuffer, size_t layer, int level = 0, int levels = 1);

/// Products of unit normals in float are off by this much: guards by a cosine allow for it, so that an angle of 0 is a plane.
inline constexpr float kRoundedCosine = 1e-6f;

/// Whether neighbours e and f lie on one surface. `cosine`: of the largest angle between their normals.
bool onOneSurface(const ContourInput& in, size_t e, size_t f, float cosine);

/// Appends the segments of the square whose top left sample is (x, y), x < width - 1 and y < height - 1.
void extractSquare(const ContourInput& in, int x, int y, float cosine, std::vector<ContourSegment>& out);

/// `squares`, where it is given: of each segment, the top left sample of its square. Errors: Cancelled.
Result<std::vector<ContourSegment>> extractContour(const ContourInput& in, float cosine, const TaskArena& arena, const StopToken& stop,
                                                   std::vector<uint32_t>* squares = nullptr);

}  // namespace filters
}  // namespace gobo

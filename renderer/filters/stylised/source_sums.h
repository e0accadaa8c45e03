// SPDX-License-Identifier: Apache-2.0
// The loops of the averaged distance over one patch of at most 64 points: sums over its sources in units of each point's own nearest distance.
// In float, about the patch's centre and in units of its nearest source: far and near scales of a scene do not meet in one number, and some hundred positive
// terms add up to 1e-6.
#pragma once

#include "filters/stylised/contour_tree.h"
#include "filters/stylised/interpolated_sums.h"

namespace gobo {
inline namespace filters {

inline constexpr size_t kPatchPoints = 64;

inline constexpr size_t kLanes = 8;  ///< points are taken by so many at once: arrays hold copies of the last one up to a multiple

struct PatchPoints {
  size_t lanes = 0;                                         ///< points, rounded up to a multiple of kLanes
  float x[kPatchPoints], y[kPatchPoints], z[kPatchPoints];  ///< from the patch's centre, in units
  float nearest2[kPatchPoints];                             ///< square of the nearest distance so far, in units
  float sum[kPatchPoints];                                  ///< integral of (r / nearest)^-p, in units
};

/// What segments that stay segments are summed at: places and squares of scene units in double, for they may be as near as they like.
struct NearPoints {
  size_t lanes = 0;
  double x[kPatchPoints], y[kPatchPoints], z[kPatchPoints];  ///< from the patch's centre
  float nx[kPatchPoints], ny[kPatchPoints], nz[kPatchPoints];
  double nearest2[kPatchPoints];
  double length[kPatchPoints];  ///< of guarded segments that are seen
  double sum[kPatchPoints];     ///< integral of (r / nearest)^-p, scene units
};

/// A segment about the patch's centre.
struct NearSegment {
  double ax, ay, az, ux, uy, uz, length;  ///< u: unit
  float nx, ny, nz, cosine;               ///< of those that see it; -2: everyone
};

/// nearest2 = min(nearest2, squared distances to the segments), length += those of guarded ones, where they are seen.
void nearestSegments(const std::vector<NearSegment>& segments, NearPoints& points);
/// sum += what the segments give, to 1e-6 of each. nearest2 is final; where it is 0 or infinite sums are anything.
void addSegments(const std::vector<NearSegment>& segments, int p, NearPoints& points);

/// d[k] = ratio[k]^exponent of n, for loops.
void powers(const float* ratio, float exponent, size_t n, float* d);

/// A source about the patch's centre, in units.
struct PatchSource {
  float x, y, z, length;
  float moment[6];
  bool point;
};
PatchSource patchSource(const PatchSources::Source& source, const DVec3& centre, double unit);

/// nearest2 = min(nearest2, squared distances to the sources).
void nearestSources(const std::vector<PatchSource>& sources, PatchPoints& points);
/// sum += what the sources give; nearest2 > 0.
void addSources(const std::vector<PatchSource>& sources, int p, PatchPoints& points);

/// Points of a patch as they come.
struct SurfacePatch {
  float x[kPatchPoints], y[kPatchPoints], z[kPatchPoints], nx[kPatchPoints], ny[kPatchPoints], nz[kPatchPoints], width[kPatchPoints];
  uint32_t id[kPatchPoints];
};
/// Whether all are of the first one's id, their normals' product with its at least `cosine`, and within `reach` widths of it.
bool isOneSurface(const SurfacePatch& p, float cosine, float reach);
/// Least and largest of `n` products of places less `from` with a vector.
struct Span {
  float low, high;
};
Span spanAlong(const SurfacePatch& p, const Vec3& from, const Vec3& along);
/// Largest square of a distance from a point, and least product of a normal with an axis.
void boundsOf(const SurfacePatch& p, const Vec3& from, const Vec3& axis, float& farthest2, float& least);

/// sum[k] of the polynomials at places u, v of -1 .. 1; n is a multiple of kLanes.
void interpolated(const InterpolatedSum& of, const float* u, const float* v, size_t n, float* sum);

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// L_p-averaged distance of one point to a contour of segments, term by term: the reference of the field (filters/stylised/distance_field.h), and its near
// field.
//
// Computes     A = sum over segments of  integral |x - y|^-p dy,  exactly (no points in a segment's place), with the segments whose normals are within
// `cosine`;
//              LOCAL       D = (A / c_p)^(-1/(p-1)),  c_p = sqrt(pi) Gamma((p-1)/2) / Gamma(p/2): d at distance d from an infinite straight contour
//              PUBLISHED   D = (A / L)^(-1/p),  L the segments' length: the power mean of equation 3.2, which grows with L; near a straight contour it is
//                          (L/c_p)^(1/p) d^((p-1)/p)
//              Both tend to the distance of the nearest point as p grows.
// Numerics     double. Sums are in units of the nearest distance to the power -p: nothing overflows for p up to 64 and any scale. An integral is cut in halves
//              until a Gauss rule of four points is exact to 1e-10 of it, which at distance h of a segment of length l takes log2(l/h) cuts.
#pragma once

#include <span>

#include "filters/stylised/contour.h"

namespace gobo {
inline namespace filters {

enum class StyleNorm : uint8_t { Local, Published };

inline constexpr float kStyleFar = 1e30f;  ///< distance where there is no contour to see

/// c_p of above; p >= 2.
double straightLineConstant(int p);

/// Integral over the segment from a to b of (|x - y|^2 / unit2)^(-p/2) dy, x on neither; unit2 > 0.
double inversePowerIntegral(const DVec3& x, const DVec3& a, const DVec3& b, int p, double unit2);
double squaredDistanceToSegment(const DVec3& x, const DVec3& a, const DVec3& b);

/// D of above from sum = A unit^p, unit2 the square of the unit; both positive.
double averagedDistance(double sum, double length, double unit2, int p, StyleNorm norm);

/// D of point x with normal n, at least 0; kStyleFar without a segment that it sees. O(segments).
double averagedDistanceTo(std::span<const ContourSegment> contour, const Vec3& x, const Vec3& n, int p, StyleNorm norm, float cosine);

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Soft shadows of area lights from one depth map seen from the light's centre (Fernando 2005; Annen et al. 2008; Yang et al. 2010).
//
//   light_depth_map -> depth_bounds -----------------------------------+-> soft lookup -> V
//                  \-> shadow_encode -> [summed_area | shadow_mipmap] -+
//
// Every technique does the same three steps for a view sample at depth d:
//   1. search   the part of the map in which anything could come between it and the light, found by the pyramid of depth bounds: the cone cut at
//               the smallest depth in it, until that no longer grows. All on one side: done (V = 1 or 0).
//   2. blockers their mean depth z over that kernel, and from it the width of the penumbra's kernel, size (d - z) / (d z)
//   3. filter   visible share of the kernel of that width
// and they differ in how 2 and 3 are read: comparisons (percentage closer: at taps or, `dense`, at every texel), Fourier images and their
// products with z, or moments, in boxes of constant cost.
//
// Lights: Rect (width and height apart: the map's axes are the rectangle's), Disk as the square of equal area, Sphere as the square of equal area
// across the direction to it (six faces), Directional of some angular size as the square at infinity of equal solid angle (one without: one texel).
// Kernels are at least one texel wide; what lies outside the map is left out of means. Kernels may be wider than the map.
// Receivers: where the whole light is below the shading normal's horizon V = 1 (terms/visibility.h), below the geometric one's only V = 0;
// where it is partly below, V is the visible part of what is above.
// Weak points: one blocker depth per kernel (layers of blockers at different depths), only what the light's centre sees casts shadows, lights
// that are textured count as uniform, receivers more than 75 degrees off a flat light's axis count as lit.
// Cost per view sample that is not decided in step 1: percentage closer (search + filter) x ~2 ns or the kernel's area; convolution 2 boxes of 4 M + 1 and
// 2 M images; variance 2 boxes of 2 (more where kernels are cut). Bytes: docs/shadow_maps.md.
#pragma once

#include "filters/shadow_map/shadow_map.h"
#include "terms/view_place.h"

namespace gobo {
inline namespace filters {

/// What soft lookups know of the light.
struct SoftLight {
  Vec2 size{0.0f};  ///< metres along the map's right and up; orthographic: 2 tan of half the angle
  Vec2 half{0.0f};  ///< half extents of the light itself, for its horizon: metres (perspective) or tangents; the radius of what is round
  enum Shape { Rectangle, Disk, Sphere } shape = Rectangle;
  void hash(Hasher& h) const { h.addPod(size).addPod(half).add(int(shape)); }
};

/// A light as soft shadow maps see it: a disk or sphere by the square of equal area, a sun by that of equal solid angle.
SoftLight softLight(const LightShape& light);

struct SoftLookup {
  LightFrames frames;
  ShadowMapSettings map;
  ShadowView view;
  SoftLight light;
  ViewPlace place;
  void hash(Hasher& h) const;
};

struct PercentageCloserSoftLookup : SoftLookup {
  int searchTaps = 32, filterTaps = 64;
  bool dense = false, skip = true;
  bool work = false;  ///< whether there is a plane "work": SoftWork of each view sample (soft_kernels.h)
};
/// Filter, term "visibility", plane V f32 in [0,1]. Inputs: "gbuffer", "depth_bounds".
NodePtr makePercentageCloserSoftNode(const PercentageCloserSoftLookup& lookup);

/// 4 M + 1 images in [-1,1]: sin(c_k z), cos(c_k z) for k = 1..M, z times each of them, and z (thesis 8.2.1, "CSM-Z").
ShadowBasisPtr makeConvolutionSoftBasis(int order);
struct ConvolutionSoftLookup : SoftLookup {
  int order = 4;
  v1::ConvolutionShadow::Correction correction = v1::ConvolutionShadow::SHIFTED_SCALING;
  v1::ConvolutionSoftShadow::Search search = v1::ConvolutionSoftShadow::Z_MIN;
  float sharpening = 0.0f, sharpeningExtent = 20.0f;
};
/// Inputs: "gbuffer", "depth_bounds", "shadow_summed_area" or (map.lookup TRILINEAR) "shadow_basis" chain of the basis above.
NodePtr makeConvolutionSoftNode(const ConvolutionSoftLookup& lookup);

struct VarianceSoftLookup : SoftLookup {
  float minVariance = 1e-6f;
  bool subdivide = true;
};
/// Inputs: "gbuffer", "depth_bounds", "shadow_moment_sums" (moment_sums.h).
NodePtr makeVarianceSoftNode(const VarianceSoftLookup& lookup);

struct ExponentialVarianceSoftLookup : SoftLookup {
  int searchTaps = 16;
  float cPositive = 20.0f, cNegative = 5.0f, bleedingReduction = 0.1f;
};
/// Inputs: "gbuffer", "depth_bounds", "shadow_basis" chain of the exponential variance basis.
NodePtr makeExponentialVarianceSoftNode(const ExponentialVarianceSoftLookup& lookup);

}  // namespace filters
}  // namespace gobo

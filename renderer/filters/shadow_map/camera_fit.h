// SPDX-License-Identifier: Apache-2.0
// Camera fit: a light's frames narrowed to what one camera can see and what can shadow that (thesis figures 6.11 - 6.13; digest 3.3). The step
// that a filtered map blurs the shadow test into is a share of the depth range, so halving the range halves the distance that light leaks.
// A pure function of camera, light and scene bounds: no depth is read back, and equal requests have equal keys.
#pragma once

#include "filters/shadow_map/light_frame.h"

namespace gobo {
inline namespace filters {

struct CameraFit {
  Camera camera;
  float aspect = 1.0f;  ///< width over height of the picture
  /// Hard shadows: the range is that of receivers alone, casters in front of it lie on its near plane ("pancaking"), which is all that
  /// a comparison needs. Soft shadows measure distances to casters: their range begins at the nearest caster.
  bool pancake = true;
  /// Soft shadows: half extent of the light along the map's axes, metres (perspective) or tangents (orthographic): casters beside a receiver's
  /// own texel matter that far.
  Vec2 lightHalf{0.0f};
};

/// The smallest of 2^e (8 + m) / 8, m = 0..7, not below v; v > 0.
double snappedSize(double v);
/// An interval that holds [a, b] and begins at a multiple of an eighth of its size, which depends on b - a alone: it stays while [a, b]
/// moves by less than that, and never is longer than 81/56 (b - a).
struct Interval {
  double lo, hi;
};
Interval snappedInterval(double a, double b);

/// Narrows `frames`, as fitLightFrames made them for the bounds [lo, hi], `resolution` and `rimTexels`. A window or range that would not become
/// narrower stays as it is, so that a camera that sees everything shares the scene's map. Faces in which the camera sees nothing lose `sees`.
void fitToCamera(LightFrames& frames, const CameraFit& fit, const Vec3& lo, const Vec3& hi, int resolution, int rimTexels);

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Elongation of a shadow: drawn out along its surface, away from the light.
//
// Computes     D'(x) = min over s in [0, e] of D(x - s t): the shadow joined with itself moved by every s up to e along t, and so is each of its offsets. t is
//              the direction in which light travels at x (from its place, or along its direction), in the tangent plane of x, unit. Where light comes along the
//              normal there is no t, and D' = D.
// The walk     goes back from x along its tangent line, through the picture: at most a pixel a step, by the camera that made the G-buffer. What the picture
// shows
//              there counts where it lies on the line, within the width of a pixel along its normal, and its normal within `angle` of x's. What does not is
//              skipped: something that stands before the surface or on it does not end the walk. Where the surface has left the line by a quarter of a pixel
//              the line is laid anew, tangent there and with the light's direction there: on curved receivers the walk follows them, and on planes never turns.
//              It ends at length e, at the picture's border, at the camera's plane, or where light comes along the normal. D between four samples that are
//              linked (filters/stylised/surface_links.h) is bilinear, elsewhere that of the nearest sample.
// Inputs       0: plane D (filters/stylised/distance_field.h); 1: "gbuffer" (P, N, Ng, instance, footprint) of the camera in the settings.
// Output       term "style_distance", plane D, at most that of input 0.
// Parameters   length >= 0, metres. 0 copies; plans leave it out.
// Error        A disc of radius R becomes a stadium of area pi R^2 + 2 R e within the raster's error; D between samples is taken for linear.
// Cost         min(e, what the picture shows of it) in pixels, times 30 to 40 ns a sample: as long as the field for some 10 pixels, ten times that for 100.
// Fails where  the surface behind something, or outside the picture (guard_px helps), would have brought shadow; what is out of focus by more than a pixel
//              (a camera with a lens) has walks that find nothing; lights of some size are their centre, so what lies under them is drawn out to all sides.
// Determinism  bit-identical for any number of threads. No windows: e is of the world, and how many pixels that is depends on the picture.
#pragma once

#include "scene/camera.h"
#include "terms/node.h"
#include "terms/view_place.h"

namespace gobo {
inline namespace filters {

/// Where light comes from, for a walk.
struct StyleLight {
  Vec3 place{0.0f};  ///< its centre; at infinity: the unit direction in which it travels
  bool atInfinity = false;
  /// The direction in which light travels along the surface at P with unit normal N; false where there is none.
  bool along(const Vec3& P, const Vec3& N, Vec3& t) const;
};

struct StyleElongationSettings {
  Extent extent;
  float length = 0;           ///< e, metres
  float angle = 0.78539816f;  ///< radians
  StyleLight light;
  Camera camera;  ///< of the G-buffer
  ViewPlace place;
};

NodePtr makeStyleElongationNode(const StyleElongationSettings& settings);

}  // namespace filters
}  // namespace gobo

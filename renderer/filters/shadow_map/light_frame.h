// SPDX-License-Identifier: Apache-2.0
// LightFrame: the light's view of the scene that a shadow map is made in. Map coordinates (u, v) in [0,1]^2 with texel (0,0) at
// (0,0); depth is *planar* along `forward`, linear, 0 at the near plane and 1 at the far plane (Annen 2008, 3.2.2). A plain
// value of fixed size: nodes carry it as a parameter, so filters need neither the light nor the scene.
#pragma once

#include <array>

#include "base/hash.h"
#include "base/status.h"
#include "scene/camera.h"
#include "scene/light.h"

namespace gobo {
inline namespace filters {

/// Widest half angle of a perspective map: beyond it texels at the rim grow without bound (tan), points there count as lit.
inline constexpr float kMaxHalfAngle = 75.0f * kPi / 180.0f;

struct LightFrame {
  bool perspective = false;
  Vec3 origin{0.0f};  ///< perspective: the light; orthographic: centre of the scene bounds
  Vec3 right{1, 0, 0}, up{0, 1, 0}, forward{0, 0, 1};
  Vec2 lo{-1.0f}, hi{1.0f};       ///< window: tangents (perspective) or metres (orthographic)
  float near = 0.0f, far = 1.0f;  ///< metres along `forward` from the origin; may be negative when orthographic
  float start = 0.0f;             ///< orthographic: where rays begin, in front of every caster; what lies between start and near has depth 0
  bool sees = true;               ///< false: nothing of the scene lies in it, or nothing that the camera sees: needs no ray

  /// Rows of the affine map on p = P - origin: u = rows[0]/rows[2], v = rows[1]/rows[2], d = rows[3]; row: x, y, z, constant.
  struct Rows {
    Vec4 u, v, w, d;
  };
  Rows rows() const;
  /// Ray through (u, v); its planar depth at distance t is startDepth + t * cosine.
  Ray ray(float u, float v, float& startDepth, float& cosine) const;
  void hash(Hasher& hasher) const;
};

/// What the window of a tilted light within the bounds takes in.
///   InFront  all of the bounds that lies in front of the light, up to the cone or 75 degrees
///   Corners  the bounds' corners: walls that pass the light's plane on its way to none of them are left out. For soft lookups: such walls are as near to the
///            light as its own width, where their estimates take them for blockers of everything beside (lights8, key light: RMSE 0.20 with them, 0.13 without)
enum class MapWindow : uint8_t { InFront, Corners };

/// Fits a frame to the bounds [lo, hi] of all casters and receivers (not to a camera: the map serves every view).
///   Directional       orthographic, window and depth tight around the bounds
///   Spot              perspective, at most the cone (cosOuter), tight around the bounds where they lie in front of the light
///   Rect, Disk, Sphere  perspective from the centre along `axis`, within 75 degrees of it: a hard-edged stand-in for the area light
/// The window is square and has a rim of `rimTexels` of `resolution` around it for the pre-filter. Empty bounds give a frame that
/// sees nothing. Errors: Unimplemented for other kinds; InvalidArgument for a light or bounds with non-finite numbers.
Result<LightFrame> fitLightFrame(const LightShape& light, const Vec3& lo, const Vec3& hi, int resolution, int rimTexels, MapWindow window = MapWindow::InFront);

/// The frames of one light's map: one, or six faces of a cube for lights that shine all round.
struct LightFrames {
  std::array<LightFrame, 6> face;
  int count = 1;
  void hash(Hasher& hasher) const;
};
/// Which face of a cube sees direction p from its centre: 0 +x, 1 -x, 2 +y, 3 -y, 4 +z, 5 -z; ties go to the earlier axis.
inline int cubeFace(const Vec3& p) {
  const Vec3 a(std::fabs(p.x), std::fabs(p.y), std::fabs(p.z));
  if (a.x >= a.y && a.x >= a.z) return p.x < 0.0f;
  if (a.y >= a.z) return 2 + (p.y < 0.0f);
  return 4 + (p.z < 0.0f);
}
/// As fitLightFrame; Point and Sphere get six faces, each a little wider than 90 degrees: by the rim and the texel that bilinear lookups
/// reach over, so that filters never meet a seam.
Result<LightFrames> fitLightFrames(const LightShape& light, const Vec3& lo, const Vec3& hi, int resolution, int rimTexels,
                                   MapWindow window = MapWindow::InFront);

}  // namespace filters
}  // namespace gobo

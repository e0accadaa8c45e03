// SPDX-License-Identifier: Apache-2.0
// LightProfile: what of a point or spot light's intensity goes where, a dimensionless factor by direction. Two kinds:
//   Picture     a picture in front of the lamp (a gobo), projected through a spot's cone: texels on the plane at distance 1 along the axis,
//               the outer cone touching the shorter sides, bilinear between texel centres, black outside.
//   Photometry  a table by angle (IES LM-63 type C), bilinear between its angles, relative to its largest value; black outside its vertical
//               angles. Vertical angles are from the axis, horizontal ones from the picture's right by its up.
// Axes: profileFrame() (scene/light_axes.h). Placed at a light: trace/emission_profile.h. Immutable once sealed and shared between scenes.
#pragma once

#include <memory>
#include <string>

#include "base/array.h"
#include "base/hash.h"
#include "base/status.h"
#include "base/vec.h"

namespace gobo {
inline namespace scene {

enum class ProfileKind : uint8_t { Picture, Photometry };

struct LightProfile {
  std::string name;
  ProfileKind kind = ProfileKind::Picture;
  int width = 0, height = 0;  ///< Photometry: numbers of horizontal and of vertical angles
  Array<Vec3> values;         ///< linear, row-major, finite, 0 .. kLargestProfileValue
  Array<float> vertical;      ///< Photometry: radians, ascending within 0 .. pi
  Array<float> horizontal;    ///< Photometry: radians, ascending from 0 to 2 pi, where the table closes; or 0 alone: the same all round
  Hash128 content;            ///< of all but the name; set by sealProfile
};
using LightProfilePtr = std::shared_ptr<const LightProfile>;

inline constexpr int kLargestProfileSide = 4096;
inline constexpr float kLargestProfileValue = 1e6f;

/// Sizes and angles: what look-ups rely on. O(angles).
Status checkProfileShape(const LightProfile& profile);
/// Checks everything, then fills `content`. Errors: InvalidArgument that names the field and the value.
Status sealProfile(LightProfile& profile);
size_t profileBytes(const LightProfile& profile);

/// Picture, at (0,0) its top left corner .. (1,1): bilinear, clamped to the border's texels. Outside: black.
Vec3 pictureAt(const LightProfile& profile, const Vec2& uv);
/// Photometry: angles in radians, any horizontal one.
Vec3 photometryAt(const LightProfile& profile, double vertical, double horizontal);

/// Built-in pictures (light_patterns.cpp), 256 x 256, of 8-bit values: slats, a window of panes, light through leaves.
enum class LightPattern : uint8_t { Blinds, Window, Leaves };
LightProfilePtr patternProfile(LightPattern pattern);

}  // namespace scene
}  // namespace gobo

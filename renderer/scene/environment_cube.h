// SPDX-License-Identifier: Apache-2.0
// Cube maps as environments: found by their shape or by OpenEXR's envmap attribute, and resampled to lat-long once, at load.
// The front face is the centre of the lat-long picture, the right face a quarter to the right of it (panorama seen from
// inside, not mirrored). Faces of crosses and strips are oriented as OpenGL's with x = right, y = up, z = front; faces of EXR
// cube maps as OpenEXR's technical introduction has them, so that a cube and a lat-long file that exrenvmap made of one another
// show the same environment.
// Filter: each lat-long texel is the mean of k x k directions on a regular grid over it, each looked up bilinearly in one
// face (clamped at its rim); k = 3 while the lat-long picture is 4 faces wide.
// Pure functions. Cost: about 0.3 us an output texel.
#pragma once

#include <cstddef>
#include <cstdint>

#include "base/image.h"
#include "base/stop.h"
#include "base/vec.h"

namespace gobo {
inline namespace scene {

enum class CubeLayout {
  None,             ///< lat-long
  HorizontalCross,  ///< 4 x 3 faces: top / left front right back / bottom
  VerticalCross,    ///< 3 x 4 faces: top / left front right / bottom / back upside down
  HorizontalStrip,  ///< 6 x 1: right left top bottom front back
  VerticalStrip,    ///< 1 x 6 in the same order
  ExrCube,          ///< 1 x 6: +X -X +Y -Y +Z -Z in OpenEXR's orientation
};

enum class ExrEnvironmentKind { None, LatLong, Cube };
/// The envmap attribute of an EXR file's (first) header. Reads attribute headers only, within bounds; None for anything else.
ExrEnvironmentKind exrEnvironmentKind(const uint8_t* bytes, size_t size);

/// Exact aspect ratios 4:3, 3:4, 6:1 and 1:6 with whole faces are cube maps, unless the file says lat-long.
CubeLayout cubeLayout(const Image& image, ExrEnvironmentKind kind);

/// Continuous pixel position (texel centres at half integers) of a direction in panorama axes: x right, y up, z front.
/// `face`: side of a face in pixels.
Vec2 cubePosition(CubeLayout layout, int face, const Vec3& direction, Vec2& faceMin);

/// Lat-long picture of min(4 faces, 8192) x half of it, 3 channels. CHECKs that the layout fits the image.
/// `stop` is polled every row; the picture is of no use then.
Image latLongFromCube(const Image& cube, CubeLayout layout, const StopToken& stop = {});

}  // namespace scene
}  // namespace gobo

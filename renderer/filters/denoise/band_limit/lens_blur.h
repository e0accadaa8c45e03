// SPDX-License-Identifier: Apache-2.0
// How far a lens already blurs each pixel: the band limit of its picture. Light, reflectances and normals alike are means over the disk of confusion, so that a
// filter much narrower than the disk takes out noise and hardly any picture.
#pragma once

#include "scene/camera.h"
#include "terms/node.h"

namespace gobo::denoise {

/// Larger disks count as of this radius, in pixels: filters stay small.
inline constexpr float kMostBlur = 24.0f;

/// Input: G-buffer (P, depth). Output "lens_blur", plane blur f32: pixels, radius of the smallest disk of confusion (formulas/lens.glsl.h) of any view sample
/// of the 3 x 3 pixels around: where something sharp is seen, or just beside, 0. At most kMostBlur. A camera with a lens, no panorama. height: of the whole
/// picture.
NodePtr makeLensBlurNode(const Camera& camera, int pictureHeight, int width, int height, int viewSamples);

}  // namespace gobo::denoise

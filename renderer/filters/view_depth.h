// SPDX-License-Identifier: Apache-2.0
// Depth along the view axis: what compositing programs and depth cameras call Z, beside the G-buffer's distance along the ray.
#pragma once

#include "scene/camera.h"
#include "terms/node.h"

namespace gobo {
inline namespace filters {

/// Input: G-buffer. Output: "pixels", plane "z_depth", metres: mean over the view samples that hit something of the distance along the camera's
/// axis (panorama: along the ray); 0 where none does. One pass; double arithmetic. Of the camera, only place and axis count.
NodePtr makeViewDepthNode(const Camera& camera, int width, int height, int viewSamples);

}  // namespace filters
}  // namespace gobo

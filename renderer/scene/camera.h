// SPDX-License-Identifier: Apache-2.0
// Camera: pinhole (perspective) or orthographic, with optional off-centre window. Looks along -Z of its frame, +Y up.
#pragma once

#include <string>

#include "base/vec.h"

namespace gobo {

struct Camera {
  std::string name = "camera";
  Mat4 toWorld{1.0f};         ///< rigid; columns are right, up, back, position
  bool perspective = true;
  float yfov = 0.8f;          ///< perspective: full vertical angle, radians
  float yheight = 2.0f;       ///< orthographic: full height of the window, metres
  Vec2 centre{0.0f};          ///< off-centre shift of the window in units of its height (x right, y up)
};

struct Ray {
  Vec3 origin, direction;     ///< direction is unit
  float tmin = 0.0f, tmax = 3.0e38f;
};

/// Camera ray through film position (px, py) in pixels, (0,0) = top left corner of the picture, of a width x height picture.
Ray cameraRay(const Camera& camera, int width, int height, float px, float py);
/// World-space width of a pixel at distance `t` along the view axis-perpendicular direction (perspective: 2 t tan(fov/2)/h).
float pixelFootprint(const Camera& camera, int height, float t);


/// Where a point is seen: pixels from the top left corner, the inverse of cameraRay. `p.w` 1: a point; 0: the direction of something
/// infinitely far. False where the camera cannot see it: behind a perspective camera, or at infinity for an orthographic one.
bool filmPosition(const Camera& camera, int width, int height, const glm::dvec4& p, glm::dvec2& film);
/// To the camera's frame as OpenEXR names it: left-handed, x right, y up, z forward. For column vectors.
Mat4 worldToCamera(const Camera& camera);
/// To (0,0) top left .. (1,1) bottom right after division by w, for column vectors; z / w is 1 / depth (perspective) or depth.
Mat4 worldToNdc(const Camera& camera, int width, int height);

}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Camera: pinhole (perspective) or orthographic, with optional off-centre window. Looks along -Z of its frame, +Y up.
#pragma once

#include <string>

#include "base/vec.h"

namespace gobo {

struct Camera {
  std::string name = "camera";
  Mat4 toWorld{1.0f};  ///< rigid; columns are right, up, back, position
  bool perspective = true;
  float yfov = 0.8f;           ///< perspective: full vertical angle, radians
  float yheight = 2.0f;        ///< orthographic: full height of the window, metres
  bool cullBackFaces = false;  ///< its rays pass back faces of single-sided materials (trace/back_faces.h); light meets them all the same
  Vec2 centre{0.0f};           ///< off-centre shift of the window in units of its height (x right, y up)
};

struct Ray {
  Vec3 origin, direction;  ///< direction is unit
  float tmin = 0.0f, tmax = 3.0e38f;
};

/// Rays of a width x height picture: what cameraRay and pixelFootprint give, without their tangent per call.
class FilmRays {
 public:
  FilmRays(const Camera& camera, int width, int height)
      : right_(camera.toWorld[0]),
        up_(camera.toWorld[1]),
        back_(camera.toWorld[2]),
        position_(camera.toWorld[3]),
        centre_(camera.centre),
        width_(float(width)),
        height_(float(height)),
        aspect_(float(width) / float(height)),
        tangent_(std::tan(0.5f * camera.yfov)),
        yheight_(camera.yheight),
        perspective_(camera.perspective) {}
  Ray at(float px, float py) const {
    // Window coordinates in units of the window's height: x right, y up, (0,0) at its centre before the off-centre shift.
    const float wx = (px / width_ - 0.5f) * aspect_ + centre_.x;
    const float wy = 0.5f - py / height_ + centre_.y;
    Ray ray;
    if (perspective_) {
      const float scale = 2.0f * tangent_;
      ray.origin = position_;
      ray.direction = glm::normalize(right_ * (wx * scale) + up_ * (wy * scale) - back_);
    } else {
      ray.origin = position_ + right_ * (wx * yheight_) + up_ * (wy * yheight_);
      ray.direction = glm::normalize(-back_);
    }
    return ray;
  }
  float footprint(float t) const { return perspective_ ? 2.0f * t * tangent_ / height_ : yheight_ / height_; }

 private:
  Vec3 right_, up_, back_, position_;
  Vec2 centre_;
  float width_, height_, aspect_, tangent_, yheight_;
  bool perspective_;
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

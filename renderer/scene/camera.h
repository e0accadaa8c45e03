// SPDX-License-Identifier: Apache-2.0
// Camera: pinhole (perspective), orthographic, or a panorama of all directions, with optional off-centre window. Looks along -Z of its frame, +Y up.
#pragma once

#include <string>

#include "base/hash.h"
#include "base/vec.h"

namespace gobo {
inline namespace scene {

/// What a request alone gives a camera (no scene file has it): the intrinsics of a measured camera, clipping, the panorama.
struct CameraOptics {
  static constexpr float kNoEnd = 3.0e38f;
  double focal = 0.0;        ///< perspective: focal length in units of the picture's height; 0: as yfov says
  float pixelAspect = 1.0f;  ///< width over height of a pixel: focal_y / focal_x
  float clipNear = 0.0f;     ///< the camera sees nothing nearer than this plane across its axis (panorama: sphere), metres
  float clipFar = kNoEnd;    ///< nor what lies behind this one
  bool panorama = false;     ///< all directions, lat-long: the middle looks along the axis, the top row up, right is right
  float lensRadius = 0.0f;   ///< of a thin lens about the camera's position, metres; 0: a pinhole
  float focus = 0.0f;        ///< with a lens: distance along the axis of the plane that is sharp, metres
};

struct Camera {
  std::string name = "camera";
  Mat4 toWorld{1.0f};  ///< rigid; columns are right, up, back, position
  bool perspective = true;
  float yfov = 0.8f;           ///< perspective: full vertical angle, radians
  float yheight = 2.0f;        ///< orthographic: full height of the window, metres
  bool cullBackFaces = false;  ///< its rays pass back faces of single-sided materials (trace/back_faces.h); light meets them all the same
  Vec2 centre{0.0f};           ///< off-centre shift of the window in units of its height (x right, y up)
  CameraOptics optics{};

  /// Height of the window: at distance 1 (perspective), or in metres (orthographic).
  float windowHeight() const { return !perspective ? yheight : optics.focal > 0.0 ? float(1.0 / optics.focal) : 2.0f * std::tan(0.5f * yfov); }
  double windowHeight64() const { return !perspective ? double(yheight) : optics.focal > 0.0 ? 1.0 / optics.focal : 2.0 * std::tan(0.5 * double(yfov)); }
  bool hasLens() const { return optics.lensRadius > 0.0f; }
  bool clips() const { return optics.clipNear > 0.0f || optics.clipFar < CameraOptics::kNoEnd; }
};
/// What of `optics` is not as in every scene; nothing else, so that cameras without it keep their keys.
void hashOptics(Hasher& hasher, const Camera& camera);

struct Ray {
  Vec3 origin, direction;  ///< direction is unit
  float tmin = 0.0f, tmax = 3.0e38f;
};

/// A thin lens: rays through the point `onDisk` of the unit disk leave there and meet the pinhole's ray in the plane of focus (Cook, Porter and
/// Carpenter 1984). An orthographic camera's is telecentric: a lens for each ray.
class ThinLens {
 public:
  explicit ThinLens(const Camera& camera)
      : right_(Vec3(camera.toWorld[0]) * camera.optics.lensRadius),
        up_(Vec3(camera.toWorld[1]) * camera.optics.lensRadius),
        inverseFocus_(camera.hasLens() ? 1.0f / camera.optics.focus : 0.0f) {}
  /// `toPlane`: along the pinhole's ray, 1 metre along the axis; still so afterwards.
  void bend(const Vec2& onDisk, Vec3& origin, Vec3& toPlane) const {
    const Vec3 aside = right_ * onDisk.x + up_ * onDisk.y;
    origin += aside;
    toPlane -= aside * inverseFocus_;
  }

 private:
  Vec3 right_, up_;
  float inverseFocus_;
};

struct RayPacket;  // scene/ray_packet.h

/// Rays of a width x height picture: what cameraRay and pixelFootprint give, without their tangent per call. They begin and end at the clipping planes.
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
        aspect_(float(width) / float(height) * camera.optics.pixelAspect),
        scale_(camera.optics.panorama ? kPi : camera.windowHeight()),
        near_(camera.optics.clipNear),
        far_(camera.optics.clipFar),
        perspective_(camera.perspective),
        panorama_(camera.optics.panorama),
        lens_(camera) {}
  /// Through a film position and, if there is a lens, a point of its unit disk.
  Ray at(float px, float py, const Vec2& onLens = Vec2(0.0f)) const {
    if (panorama_) return around(px, py);
    // Window coordinates in units of the window's height: x right, y up, (0,0) at its centre before the off-centre shift.
    const float wx = (px / width_ - 0.5f) * aspect_ + centre_.x;
    const float wy = 0.5f - py / height_ + centre_.y;
    Ray ray;
    ray.origin = position_;
    Vec3 toPlane = -back_;  // as far as the plane at distance 1
    const Vec3 aside = right_ * (wx * scale_) + up_ * (wy * scale_);
    if (perspective_) toPlane = aside - back_;
    else ray.origin += aside;
    const bool bent = onLens != Vec2(0.0f);
    if (bent) lens_.bend(onLens, ray.origin, toPlane);
    ray.direction = glm::normalize(toPlane);
    clip(ray, perspective_ || bent ? glm::length(toPlane) : 1.0f);
    return ray;
  }
  /// Height of a pixel at distance t.
  float footprint(float t) const { return perspective_ ? t * scale_ / height_ : scale_ / height_; }

 private:
  friend void filmPacket(const FilmRays& film, const float (&px)[16], const float (&py)[16], RayPacket& rays);
  Ray around(float px, float py) const {
    const float azimuth = (px / width_ - 0.5f) * (2.0f * kPi), height = (0.5f - py / height_) * kPi, level = std::cos(height);
    Ray ray;
    ray.origin = position_;
    ray.direction = glm::normalize(right_ * (level * std::sin(azimuth)) + up_ * std::sin(height) - back_ * (level * std::cos(azimuth)));
    clip(ray, 1.0f);
    return ray;
  }
  /// `slant`: way along the ray per metre along the axis.
  void clip(Ray& ray, float slant) const {
    if (near_ > 0.0f) ray.tmin = near_ * slant;
    if (far_ < CameraOptics::kNoEnd) ray.tmax = far_ * slant;
  }

  Vec3 right_, up_, back_, position_;
  Vec2 centre_;
  float width_, height_, aspect_, scale_, near_, far_;
  bool perspective_, panorama_;
  ThinLens lens_;
};

/// Camera ray through film position (px, py) in pixels, (0,0) = top left corner of the picture, of a width x height picture.
Ray cameraRay(const Camera& camera, int width, int height, float px, float py);
/// World-space height of a pixel at distance `t` (perspective: 2 t tan(fov/2)/h; panorama: pi t / h).
float pixelFootprint(const Camera& camera, int height, float t);

/// Where a point is seen: pixels from the top left corner, the inverse of cameraRay. `p.w` 1: a point; 0: the direction of something
/// infinitely far. False where the camera cannot see it: behind a perspective camera, or at infinity for an orthographic one. Clipping does not matter.
bool filmPosition(const Camera& camera, int width, int height, const glm::dvec4& p, glm::dvec2& film);
/// To the camera's frame as OpenEXR names it: left-handed, x right, y up, z forward. For column vectors.
Mat4 worldToCamera(const Camera& camera);
/// To (0,0) top left .. (1,1) bottom right after division by w, for column vectors; z / w is 1 / depth (perspective) or depth. Not of a panorama, which
/// no matrix makes.
Mat4 worldToNdc(const Camera& camera, int width, int height);

}  // namespace scene
}  // namespace gobo

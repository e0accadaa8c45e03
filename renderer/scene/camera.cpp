// SPDX-License-Identifier: Apache-2.0
#include "scene/camera.h"

namespace gobo {
inline namespace scene {

void hashOptics(Hasher& h, const Camera& camera) {
  const CameraOptics &o = camera.optics, none;
  if (o.focal != none.focal) h.add("focal").add(o.focal);
  if (o.pixelAspect != none.pixelAspect) h.add("pixelAspect").add(o.pixelAspect);
  if (o.clipNear != none.clipNear) h.add("clipNear").add(o.clipNear);
  if (o.clipFar != none.clipFar) h.add("clipFar").add(o.clipFar);
  if (o.panorama) h.add("panorama");
  if (camera.hasLens()) h.add("lens").add(o.lensRadius).add(o.focus);
}

Ray cameraRay(const Camera& camera, int width, int height, float px, float py) { return FilmRays(camera, width, height).at(px, py); }

float pixelFootprint(const Camera& camera, int height, float t) { return FilmRays(camera, 1, height).footprint(t); }

bool filmPosition(const Camera& camera, int width, int height, const glm::dvec4& p, glm::dvec2& film) {
  const DVec3 d = DVec3(p) - DVec3(camera.toWorld[3]) * p.w;
  const double x = glm::dot(d, DVec3(camera.toWorld[0])), y = glm::dot(d, DVec3(camera.toWorld[1])), depth = -glm::dot(d, DVec3(camera.toWorld[2]));
  if (camera.optics.panorama) {
    if (x == 0.0 && y == 0.0 && depth == 0.0) return false;
    film.x = (std::atan2(x, depth) / (2.0 * M_PI) + 0.5) * width;
    film.y = (0.5 - std::atan2(y, std::hypot(x, depth)) / M_PI) * height;
    return std::isfinite(film.x) && std::isfinite(film.y);
  }
  if (camera.perspective ? !(depth > 0.0) : p.w == 0.0) return false;
  const double scale = camera.perspective ? camera.windowHeight64() * depth : camera.windowHeight64();
  film.x = ((x / scale - double(camera.centre.x)) * double(height) / (double(width) * double(camera.optics.pixelAspect)) + 0.5) * width;
  film.y = (0.5 - (y / scale - double(camera.centre.y))) * height;
  return std::isfinite(film.x) && std::isfinite(film.y);
}

Mat4 worldToCamera(const Camera& camera) {
  const Vec3 rows[3] = {Vec3(camera.toWorld[0]), Vec3(camera.toWorld[1]), -Vec3(camera.toWorld[2])}, origin(camera.toWorld[3]);
  Mat4 m(1.0f);
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) m[c][r] = rows[r][c];
    m[3][r] = -glm::dot(rows[r], origin);
  }
  return m;
}

Mat4 worldToNdc(const Camera& camera, int width, int height) {
  const float aspect = float(width) / float(height) * camera.optics.pixelAspect, scale = camera.windowHeight();
  const float left = 0.5f - camera.centre.x / aspect, top = 0.5f + camera.centre.y;
  Mat4 p(0.0f);  // from the camera's frame: columns are x, y, depth, 1
  p[0][0] = 1.0f / (scale * aspect);
  p[1][1] = -1.0f / scale;
  const int unit = camera.perspective ? 2 : 3;  // which column w comes from
  p[unit][0] = left;
  p[unit][1] = top;
  p[unit][3] = 1.0f;
  p[camera.perspective ? 3 : 2][2] = 1.0f;
  return p * worldToCamera(camera);
}

}  // namespace scene
}  // namespace gobo

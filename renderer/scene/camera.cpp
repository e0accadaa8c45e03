// SPDX-License-Identifier: Apache-2.0
#include "scene/camera.h"

namespace gobo {

Ray cameraRay(const Camera& camera, int width, int height, float px, float py) {
  // Window coordinates in units of the window's height: x right, y up, (0,0) at its centre before the off-centre shift.
  const float aspect = float(width) / float(height);
  const float wx = (px / float(width) - 0.5f) * aspect + camera.centre.x;
  const float wy = 0.5f - py / float(height) + camera.centre.y;
  const Vec3 right(camera.toWorld[0]), up(camera.toWorld[1]), back(camera.toWorld[2]), position(camera.toWorld[3]);
  Ray ray;
  if (camera.perspective) {
    const float scale = 2.0f * std::tan(0.5f * camera.yfov);
    ray.origin = position;
    ray.direction = glm::normalize(right * (wx * scale) + up * (wy * scale) - back);
  } else {
    ray.origin = position + right * (wx * camera.yheight) + up * (wy * camera.yheight);
    ray.direction = glm::normalize(-back);
  }
  return ray;
}

float pixelFootprint(const Camera& camera, int height, float t) {
  return camera.perspective ? 2.0f * t * std::tan(0.5f * camera.yfov) / float(height) : camera.yheight / float(height);
}

}  // namespace gobo

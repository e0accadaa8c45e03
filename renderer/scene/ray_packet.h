// SPDX-License-Identifier: Apache-2.0
// 16 rays side by side, a lane each: what Embree takes, and what camera rays are made as.
#pragma once

#include "scene/camera.h"

namespace gobo {
inline namespace scene {

struct alignas(64) RayPacket {
  static constexpr int kLanes = 16;
  float origin[3][kLanes], direction[3][kLanes];  ///< component, lane; directions are unit
  float tmin[kLanes], tmax[kLanes];
  void set(int lane, const Ray& ray) {
    for (int c = 0; c < 3; ++c) {
      origin[c][lane] = ray.origin[c];
      direction[c][lane] = ray.direction[c];
    }
    tmin[lane] = ray.tmin;
    tmax[lane] = ray.tmax;
  }
};

/// What FilmRays::at gives for these film positions, bit for bit. Not for panoramas, nor for a lens, whose points are anywhere.
void filmPacket(const FilmRays& film, const float (&px)[RayPacket::kLanes], const float (&py)[RayPacket::kLanes], RayPacket& rays);

}  // namespace scene
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "scene/ray_packet.h"

namespace gobo {
inline namespace scene {

// Operations and their order are those of FilmRays::at.
void filmPacket(const FilmRays& film, const float (&px)[RayPacket::kLanes], const float (&py)[RayPacket::kLanes], RayPacket& rays) {
  constexpr int kLanes = RayPacket::kLanes;
  const float width = film.width_, height = film.height_, aspect = film.aspect_, scale = film.scale_;
  const float cx = film.centre_.x, cy = film.centre_.y;
  alignas(64) float wx[kLanes], wy[kLanes], to[3][kLanes], squared[kLanes];
  for (int i = 0; i < kLanes; ++i) {
    wx[i] = ((px[i] / width - 0.5f) * aspect + cx) * scale;
    wy[i] = (0.5f - py[i] / height + cy) * scale;
  }
  for (int c = 0; c < 3; ++c) {
    const float right = film.right_[c], up = film.up_[c], back = film.back_[c], position = film.position_[c];
    if (film.perspective_) {
      for (int i = 0; i < kLanes; ++i) {
        to[c][i] = (right * wx[i] + up * wy[i]) - back;
        rays.origin[c][i] = position;
      }
    } else {
      for (int i = 0; i < kLanes; ++i) {
        to[c][i] = -back;
        rays.origin[c][i] = position + (right * wx[i] + up * wy[i]);
      }
    }
  }
  for (int i = 0; i < kLanes; ++i) squared[i] = to[0][i] * to[0][i] + to[1][i] * to[1][i] + to[2][i] * to[2][i];
  for (int c = 0; c < 3; ++c)
    for (int i = 0; i < kLanes; ++i) rays.direction[c][i] = to[c][i] * (1.0f / std::sqrt(squared[i]));
  const bool slants = film.perspective_;
  for (int i = 0; i < kLanes; ++i) {
    const float slant = slants ? std::sqrt(squared[i]) : 1.0f;
    rays.tmin[i] = film.near_ > 0.0f ? film.near_ * slant : 0.0f;
    rays.tmax[i] = film.far_ < CameraOptics::kNoEnd ? film.far_ * slant : CameraOptics::kNoEnd;
  }
}

}  // namespace scene
}  // namespace gobo

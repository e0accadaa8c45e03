// SPDX-License-Identifier: Apache-2.0
// Rays from a transfer point, distributed as the cosine about its normal: irradiance of radiance L is pi times the mean of L over them.
#pragma once

#include "base/sobol.h"
#include "techniques/transfer/harmonics.h"
#include "trace/accel.h"

namespace gobo::transfer {

class PointRays {
 public:
  /// `cell`: size of what is about the point; it leaves the surface by a thousandth of that. `unit`: Accel::unit.
  PointRays(const Vec3& position, const Vec3& normal, float cell, float unit, uint64_t seed)
      : frame_(normal), origin_(offsetOrigin(position + normal * (1e-3f * cell), normal, unit)), seed_(seed) {}
  Ray at(uint32_t index) const {
    const Vec2 u = SobolSampler(seed_, index).next2D();
    const float r = std::sqrt(u.x), a = 2.0f * kPi * u.y;
    Ray ray;
    ray.origin = origin_;
    ray.direction = glm::normalize(frame_.toWorld(Vec3(r * std::cos(a), r * std::sin(a), std::sqrt(maxOf(1.0f - u.x, 1e-8f)))));
    return ray;
  }

 private:
  Frame frame_;
  Vec3 origin_;
  uint64_t seed_;
};

}  // namespace gobo::transfer

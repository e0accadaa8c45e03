// SPDX-License-Identifier: Apache-2.0
#include "trace/distant_light.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/check.h"
#include "scene/light_axes.h"

namespace gobo {
inline namespace trace {

DistantLight::DistantLight(const LightShape& light) : frame_(mapFrame(light)), axis_(light.axis), disk_(light.angularSize != 0.0f) {
  GOBO_CHECK(isWideDirectional(light));
  if (disk_) {
    const double sine = std::sin(0.5 * double(light.angularSize));
    sine2_ = sine * sine;
    gap_ = sine2_ / (1.0 + std::sqrt(1.0 - sine2_));
    density_ = 1.0 / (2.0 * std::numbers::pi * gap_);
    irradiance_ = std::numbers::pi * sine2_;
  } else {
    hx_ = 0.5 * light.skyRectangle.x;
    hy_ = 0.5 * light.skyRectangle.y;
    irradiance_ = 4.0 * std::asin(hx_ * hy_ / std::sqrt((1.0 + hx_ * hx_) * (1.0 + hy_ * hy_)));
  }
}

Vec3 DistantLight::sample(const Vec2& u, double& density) const {
  // Just inside, so that rounding leaves no sample outside its own density.
  constexpr double kInside = 0.99999;
  if (!disk_) {
    const Vec3 d = glm::normalize(frame_.x * float(kInside * hx_ * (2.0 * u.x - 1.0)) + frame_.y * float(kInside * hy_ * (2.0 * u.y - 1.0)) - axis_);
    density = pdf(d);
    return d;
  }
  density = density_;
  const double drop = kInside * double(u.x) * gap_, sine = std::sqrt(drop * (2.0 - drop)), phi = 2.0 * std::numbers::pi * double(u.y);
  const DVec3 d = DVec3(frame_.x) * (sine * std::cos(phi)) + DVec3(frame_.y) * (sine * std::sin(phi)) - DVec3(frame_.z) * (1.0 - drop);
  return Vec3(d / glm::length(d));
}

double DistantLight::pdf(const Vec3& direction) const {
  if (disk_) {
    const DVec3 axis(frame_.z), d(direction), across = glm::cross(d, axis);
    return glm::dot(d, axis) < 0.0 && glm::dot(across, across) <= sine2_ * glm::dot(d, d) * glm::dot(axis, axis) ? density_ : 0.0;
  }
  const double c = -glm::dot(axis_, direction);
  return c > 0 && std::fabs(glm::dot(direction, frame_.x)) <= hx_ * c && std::fabs(glm::dot(direction, frame_.y)) <= hy_ * c
             ? 1.0 / (4.0 * hx_ * hy_ * c * c * c)
             : 0.0;
}

}  // namespace trace
}  // namespace gobo

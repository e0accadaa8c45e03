// SPDX-License-Identifier: Apache-2.0
// A square picture of all normals about a direction z: those that face it are the disk of radius 1 (equal areas, a mirrored ball seen from far), those that
// face away its corners, of which -z is none.
#pragma once

#include <algorithm>
#include <cmath>

#include "base/to_index.h"
#include "base/vec.h"

namespace gobo::prefilter {

class NormalPicture {
 public:
  NormalPicture(int side, const DVec3& towards) : side_(side), z_(glm::normalize(towards)) {
    x_ = glm::normalize(glm::cross(std::fabs(z_.y) < 0.9 ? DVec3(0, 1, 0) : DVec3(1, 0, 0), z_));
    y_ = glm::cross(z_, x_);
  }
  int side() const { return side_; }
  const DVec3& towards() const { return z_; }
  size_t texels() const { return size_t(side_) * size_t(side_); }
  /// Of a texel's middle.
  DVec3 normal(int x, int y) const {
    const double u = (x + 0.5) / side_ * 2.0 - 1.0, v = (y + 0.5) / side_ * 2.0 - 1.0, square = u * u + v * v;
    const double along = 1.0 - square, across = std::sqrt(std::max(2.0 - square, 0.0));  // sin / radius: (1 - along^2) / square = 2 - square
    return along * z_ + across * (u * x_ + v * y_);
  }
  /// The texels about a normal, row-major, and their shares.
  struct Place {
    size_t texel[4];
    double share[4];
    template <class F>
    auto blend(F&& value) const {
      return (value(texel[0]) * share[0] + value(texel[1]) * share[1]) + (value(texel[2]) * share[2] + value(texel[3]) * share[3]);
    }
  };
  Place at(const DVec3& normal) const {
    const double along = glm::dot(normal, z_), a = glm::dot(normal, x_), b = glm::dot(normal, y_);
    const double length = std::hypot(a, b), scale = length > 0.0 ? std::sqrt(std::max(1.0 - along, 0.0)) / length : 0.0;
    const auto place = [&](double v) { return std::clamp((v * scale + 1.0) * 0.5 * side_ - 0.5, 0.0, double(side_ - 1)); };
    const double u = place(a), v = place(b);
    const int x0 = toIndex(u, side_), y0 = toIndex(v, side_), x1 = std::min(x0 + 1, side_ - 1), y1 = std::min(y0 + 1, side_ - 1);
    const double s = u - x0, t = v - y0;
    const auto texel = [&](int x, int y) { return size_t(y) * size_t(side_) + size_t(x); };
    return {{texel(x0, y0), texel(x1, y0), texel(x0, y1), texel(x1, y1)}, {(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t}};
  }

 private:
  int side_;
  DVec3 x_, y_, z_;  // right, up, towards who looks
};

}  // namespace gobo::prefilter

// SPDX-License-Identifier: Apache-2.0
// DistantLight: a Directional light of some angular size: a disk or a rectangle of uniform radiance at infinity. Receivers have no part in it: every
// point sees the same directions. In double inside: a sun of a hundredth of a degree still has an edge. Immutable; any thread. 60 ns a sample.
#pragma once

#include "scene/camera.h"
#include "scene/light.h"

namespace gobo {
inline namespace trace {

class DistantLight {
 public:
  /// `light`: isWideDirectional().
  explicit DistantLight(const LightShape& light);
  /// Unit direction towards the light. Disk: uniform by solid angle; rectangle: uniform on its tangent plane. density: per solid angle.
  Vec3 sample(const Vec2& u, double& density) const;
  /// Solid angle density of sample(); 0 beside the light. Directions are single precision: at the rim of the smallest disks (kLeastAngularSize)
  /// a sample may lie beside it by this function's word.
  double pdf(const Vec3& direction) const;
  /// Irradiance that radiance 1 brings, sr. Disk: on a plane facing it, exactly: pi sin^2(half angle). Rectangle: its solid angle, as
  /// terms/fit_area_lights.h has it: irradiance there is the map's flux, not what a plane collects.
  double irradiance() const { return irradiance_; }

 private:
  Frame frame_;
  Vec3 axis_;
  bool disk_;
  double gap_ = 0, sine2_ = 0, density_ = 0;  // disk: 1 - cosine and squared sine of the half angle
  double hx_ = 0, hy_ = 0;                    // rectangle: tangents of the half angles
  double irradiance_ = 0;
};

}  // namespace trace
}  // namespace gobo

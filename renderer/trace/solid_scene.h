// SPDX-License-Identifier: Apache-2.0
// Rays that meet solid surfaces only: those that light passes straight on (maySendStraight) are not there. For shadow maps and what
// judges them: the shadow of what is left over, RGB, is a term of its own (terms/visibility.h). Any thread.
#pragma once

#include <vector>

#include "trace/accel.h"

namespace gobo {
inline namespace trace {

class SolidScene {
 public:
  /// `clear` false: everything is solid, and only Topology is read; else Bsdf too.
  SolidScene(const SceneView& view, AccelPtr accel, bool clear);
  const Accel& accel() const { return *accel_; }
  bool solid(uint32_t instance) const { return passable_.empty() || !passable_[instance]; }
  /// As Accel's.
  void intersect16(const Ray* rays, int count, Hit* hits) const;
  uint32_t occluded16(const Ray* rays, int count) const;

 private:
  void beyond(Ray ray, Hit& hit) const;
  AccelPtr accel_;
  std::vector<char> passable_;  // by instance; empty: none
};

}  // namespace trace
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Scenes far from their file's origin. A float has 24 bits: at 1e6 m it steps by 6 cm. What lies far away in proportion to its size is therefore
// described from a point near it (Scene::origin); the file's numbers are doubles, and the difference is taken in them.
#pragma once

#include <limits>

#include "scene/rig.h"
#include "scene/scene.h"

namespace gobo::gltf {

/// Axis-aligned, empty at first.
struct Box {
  DVec3 lo{std::numeric_limits<double>::infinity()}, hi{-std::numeric_limits<double>::infinity()};
  void add(const DVec3& p) {
    lo = glm::min(lo, p);
    hi = glm::max(hi, p);
  }
  bool empty() const { return !(lo.x <= hi.x); }
};
Box boxOf(const Mesh& mesh);
/// Around the turned box.
Box transformed(const Box& box, const DMat4& by);

/// The middle of a box that lies more than 64 times its longest side from 0, rounded to a power of two below that side, so that taking it away
/// rounds nothing; 0 for nearer ones, points, and what lies beyond kLargestCoordinate, which is refused elsewhere.
DVec3 originFor(const Box& box);

}  // namespace gobo::gltf

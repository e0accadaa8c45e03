// SPDX-License-Identifier: Apache-2.0
// Boxes around analytic area lights (Rect, Disk, Sphere), so that a thousand of them cost a ray some twenty box tests.
// Median splits: lights are few and placed, not meshed. Immutable; any thread may trace.
#pragma once

#include <cstdint>
#include <vector>

#include "scene/camera.h"
#include "scene/light.h"

namespace gobo {

class AreaLightBvh {
 public:
  struct Entry { int light; LightShape shape; bool cameraVisible; };
  AreaLightBvh() = default;
  explicit AreaLightBvh(std::vector<Entry> entries);
  /// Nearest emitting hit within (tmin, tmax); ties go to the lower light index. Light index or -1.
  int intersect(const Ray& ray, bool cameraVisibleOnly, float& t, Vec3& Ng) const;
  bool empty() const { return entries_.empty(); }

 private:
  struct Node {
    Vec3 lo, hi;
    uint32_t first = 0;   // leaf: first entry; inner: right child (the left one follows its parent)
    uint32_t count = 0;   // leaf: entries; inner: 0
  };
  void build(uint32_t begin, uint32_t end);
  std::vector<Entry> entries_;
  std::vector<Node> nodes_;
};

}  // namespace gobo

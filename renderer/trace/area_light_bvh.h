// SPDX-License-Identifier: Apache-2.0
// Boxes around analytic area lights (Rect, Disk, Sphere), eight children a node and all eight tested at once, so that a
// thousand of them cost a ray some five node tests (50 ns) instead of a thousand sphere tests. Median splits: lights are few and
// placed, not meshed. Immutable; any thread may trace.
#pragma once

#include <cstdint>
#include <vector>

#include "scene/camera.h"
#include "scene/light.h"

namespace gobo {
inline namespace trace {

class AreaLightBvh {
 public:
  struct Entry {
    int light;
    LightShape shape;
    bool cameraVisible;
  };
  struct Hit {
    int light;
    float t;
    Vec3 Ng;
  };
  AreaLightBvh() = default;
  explicit AreaLightBvh(std::vector<Entry> entries);
  /// Nearest emitting hit within (tmin, tmax); ties go to the lower light index. Light index or -1.
  int intersect(const Ray& ray, bool cameraVisibleOnly, float& t, Vec3& Ng) const;
  /// Every light that intersectAreaLight() meets within (tmin, tmax), coincident ones included, by ascending light index: the
  /// same list, to the bit, that asking the lights one by one gives. Replaces what `hits` held.
  void collect(const Ray& ray, bool cameraVisibleOnly, std::vector<Hit>& hits) const;
  bool empty() const { return entries_.empty(); }

 private:
  static constexpr int kWidth = 8;
  struct alignas(32) Node {
    float lo[3][kWidth], hi[3][kWidth];
    uint32_t child[kWidth];  // node, or entry where the bit of `leaves` is set
    uint32_t used = 0, leaves = 0;
  };
  uint32_t build(uint32_t begin, uint32_t end);
  /// leaf(entry) for every entry whose box the ray meets before tmax, which leaf() may lower.
  template <typename Leaf>
  void traverse(const Ray& ray, const float& tmax, Leaf&& leaf) const;
  std::vector<Entry> entries_;
  std::vector<Node> nodes_;
};

}  // namespace trace
}  // namespace gobo

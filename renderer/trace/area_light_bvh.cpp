// SPDX-License-Identifier: Apache-2.0
#include "trace/area_light_bvh.h"

#include <algorithm>

#include "trace/area_lights.h"

namespace gobo {
namespace {

constexpr uint32_t kLeafSize = 2;

void lightBounds(const LightShape& s, Vec3& lo, Vec3& hi) {
  Vec3 extent(s.radius);
  if (s.kind == LightKind::Rect) extent = glm::abs(s.u) + glm::abs(s.v);
  // Slack for rounding in the box test, and thickness for flat boxes.
  extent += 1e-5f * (glm::abs(s.position) + extent) + Vec3(1e-30f);
  lo = s.position - extent;
  hi = s.position + extent;
}

/// Slab test. `inverse` is finite, so no product is NaN.
bool hitsBox(const Vec3& lo, const Vec3& hi, const Vec3& origin, const Vec3& inverse, float tmin, float tmax) {
  for (int a = 0; a < 3; ++a) {
    const float t0 = (lo[a] - origin[a]) * inverse[a], t1 = (hi[a] - origin[a]) * inverse[a];
    tmin = maxOf(tmin, t0 < t1 ? t0 : t1);
    tmax = minOf(tmax, (t0 < t1 ? t1 : t0) * 1.00001f);
  }
  return tmin <= tmax;
}

}  // namespace

AreaLightBvh::AreaLightBvh(std::vector<Entry> entries) : entries_(std::move(entries)) {
  if (entries_.empty()) return;
  nodes_.reserve(2 * entries_.size());
  build(0, uint32_t(entries_.size()));
}

void AreaLightBvh::build(uint32_t begin, uint32_t end) {
  const size_t at = nodes_.size();
  nodes_.emplace_back();
  Vec3 lo(3e38f), hi(-3e38f), cl(3e38f), ch(-3e38f);
  for (uint32_t i = begin; i < end; ++i) {
    Vec3 a, b;
    lightBounds(entries_[i].shape, a, b);
    lo = glm::min(lo, a);
    hi = glm::max(hi, b);
    cl = glm::min(cl, entries_[i].shape.position);
    ch = glm::max(ch, entries_[i].shape.position);
  }
  nodes_[at].lo = lo;
  nodes_[at].hi = hi;
  if (end - begin <= kLeafSize) {
    nodes_[at].first = begin;
    nodes_[at].count = end - begin;
    return;
  }
  const Vec3 size = ch - cl;
  const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
  const uint32_t middle = begin + (end - begin) / 2;
  std::nth_element(entries_.begin() + begin, entries_.begin() + middle, entries_.begin() + end, [axis](const Entry& a, const Entry& b) {
    const float x = a.shape.position[axis], y = b.shape.position[axis];
    return x != y ? x < y : a.light < b.light;
  });
  build(begin, middle);
  nodes_[at].first = uint32_t(nodes_.size());
  build(middle, end);
}

int AreaLightBvh::intersect(const Ray& ray, bool cameraVisibleOnly, float& t, Vec3& Ng) const {
  int best = -1;
  if (nodes_.empty()) return best;
  Ray r = ray;
  Vec3 inverse;
  for (int a = 0; a < 3; ++a) inverse[a] = 1.0f / (std::fabs(ray.direction[a]) > 1e-30f ? ray.direction[a] : 1e-30f);
  uint32_t stack[64];
  int top = 0;
  stack[top++] = 0;
  while (top) {
    const uint32_t index = stack[--top];
    const Node& node = nodes_[index];
    if (!hitsBox(node.lo, node.hi, r.origin, inverse, r.tmin, r.tmax)) continue;
    if (node.count == 0) {
      stack[top++] = node.first;
      stack[top++] = index + 1;
      continue;
    }
    for (uint32_t k = node.first; k < node.first + node.count; ++k) {
      const Entry& e = entries_[k];
      if (cameraVisibleOnly && !e.cameraVisible) continue;
      // A light at the same distance must still be found when its index is lower.
      Ray probe = r;
      if (best >= 0) probe.tmax = std::nextafter(r.tmax, 3.4e38f);
      float hit;
      Vec3 n;
      if (!intersectAreaLight(e.shape, probe, hit, n)) continue;
      if (best >= 0 && (hit > r.tmax || (hit == r.tmax && e.light > best))) continue;
      best = e.light;
      r.tmax = t = hit;
      Ng = n;
    }
  }
  return best;
}

}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "trace/area_light_bvh.h"

#include <immintrin.h>

#include <algorithm>

#include "trace/area_lights.h"

namespace gobo {
inline namespace trace {
namespace {

void lightBounds(const LightShape& s, Vec3& lo, Vec3& hi) {
  Vec3 extent(s.radius);
  if (s.kind == LightKind::Rect) extent = glm::abs(s.u) + glm::abs(s.v);
  // Slack for rounding in the box test, and thickness for flat boxes.
  extent += 1e-5f * (glm::abs(s.position) + extent) + Vec3(1e-30f);
  lo = s.position - extent;
  hi = s.position + extent;
}

}  // namespace

AreaLightBvh::AreaLightBvh(std::vector<Entry> entries) : entries_(std::move(entries)) {
  if (!entries_.empty()) build(0, uint32_t(entries_.size()));
}

uint32_t AreaLightBvh::build(uint32_t begin, uint32_t end) {
  const uint32_t at = uint32_t(nodes_.size());
  nodes_.emplace_back();
  // Halved at the median of the longest axis until there are eight parts.
  std::vector<std::pair<uint32_t, uint32_t>> parts = {{begin, end}};
  while (parts.size() < size_t(kWidth)) {
    const auto largest = std::max_element(parts.begin(), parts.end(), [](const auto& a, const auto& b) { return a.second - a.first < b.second - b.first; });
    const auto [b, e] = *largest;
    if (e - b <= 1) break;
    Vec3 lo(3e38f), hi(-3e38f);
    for (uint32_t i = b; i < e; ++i) {
      lo = glm::min(lo, entries_[i].shape.position);
      hi = glm::max(hi, entries_[i].shape.position);
    }
    const Vec3 size = hi - lo;
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    const uint32_t middle = b + (e - b) / 2;
    std::nth_element(entries_.begin() + b, entries_.begin() + middle, entries_.begin() + e, [axis](const Entry& x, const Entry& y) {
      const float p = x.shape.position[axis], q = y.shape.position[axis];
      return p != q ? p < q : x.light < y.light;
    });
    largest->second = middle;
    parts.emplace_back(middle, e);
  }
  for (size_t c = 0; c < parts.size(); ++c) {
    const auto [b, e] = parts[c];
    Vec3 lo(3e38f), hi(-3e38f);
    for (uint32_t i = b; i < e; ++i) {
      Vec3 l, h;
      lightBounds(entries_[i].shape, l, h);
      lo = glm::min(lo, l);
      hi = glm::max(hi, h);
    }
    const uint32_t child = e - b == 1 ? b : build(b, e);
    Node& node = nodes_[at];  // after build(), which moves the nodes
    node.child[c] = child;
    node.used |= 1u << c;
    if (e - b == 1) node.leaves |= 1u << c;
    for (int a = 0; a < 3; ++a) {
      node.lo[a][c] = lo[a];
      node.hi[a][c] = hi[a];
    }
  }
  for (size_t c = parts.size(); c < size_t(kWidth); ++c) {
    nodes_[at].child[c] = 0;
    for (int a = 0; a < 3; ++a) nodes_[at].lo[a][c] = nodes_[at].hi[a][c] = 0.0f;
  }
  return at;
}

template <typename Leaf>
void AreaLightBvh::traverse(const Ray& ray, const float& tmax, Leaf&& leaf) const {
  if (nodes_.empty()) return;
  __m256 origin[3], inverse[3];
  bool negative[3];
  for (int a = 0; a < 3; ++a) {
    const float d = std::fabs(ray.direction[a]) > 1e-30f ? ray.direction[a] : 1e-30f;  // finite inverse: no product is NaN
    origin[a] = _mm256_set1_ps(ray.origin[a]);
    inverse[a] = _mm256_set1_ps(1.0f / d);
    negative[a] = d < 0.0f;
  }
  const __m256 tmin = _mm256_set1_ps(ray.tmin), slack = _mm256_set1_ps(1.00001f);
  uint32_t stack[128];  // depth is log2(lights) / 3, each level leaves at most 7 behind
  int top = 0;
  stack[top++] = 0;
  while (top) {
    const Node& node = nodes_[stack[--top]];
    __m256 near = tmin, far = _mm256_set1_ps(tmax);
    for (int a = 0; a < 3; ++a) {
      const __m256 first = _mm256_load_ps(negative[a] ? node.hi[a] : node.lo[a]), second = _mm256_load_ps(negative[a] ? node.lo[a] : node.hi[a]);
      near = _mm256_max_ps(near, _mm256_mul_ps(_mm256_sub_ps(first, origin[a]), inverse[a]));
      far = _mm256_min_ps(far, _mm256_mul_ps(_mm256_mul_ps(_mm256_sub_ps(second, origin[a]), inverse[a]), slack));
    }
    uint32_t met = uint32_t(_mm256_movemask_ps(_mm256_cmp_ps(near, far, _CMP_LE_OQ))) & node.used;
    for (; met; met &= met - 1) {
      const int c = __builtin_ctz(met);
      if (node.leaves >> c & 1u) leaf(entries_[node.child[c]]);
      else stack[top++] = node.child[c];
    }
  }
}

int AreaLightBvh::intersect(const Ray& ray, bool cameraVisibleOnly, float& t, Vec3& Ng) const {
  int best = -1;
  Ray r = ray;
  traverse(ray, r.tmax, [&](const Entry& e) {
    if (cameraVisibleOnly && !e.cameraVisible) return;
    // A light at the same distance must still be found when its index is lower.
    Ray probe = r;
    if (best >= 0) probe.tmax = std::nextafter(r.tmax, 3.4e38f);
    float hit;
    Vec3 n;
    if (!intersectAreaLight(e.shape, probe, hit, n)) return;
    if (best >= 0 && (hit > r.tmax || (hit == r.tmax && e.light > best))) return;
    best = e.light;
    r.tmax = t = hit;
    Ng = n;
  });
  return best;
}

void AreaLightBvh::collect(const Ray& ray, bool cameraVisibleOnly, std::vector<Hit>& hits) const {
  hits.clear();
  traverse(ray, ray.tmax, [&](const Entry& e) {
    Hit hit;
    hit.light = e.light;
    if ((e.cameraVisible || !cameraVisibleOnly) && intersectAreaLight(e.shape, ray, hit.t, hit.Ng)) hits.push_back(hit);
  });
  if (hits.size() > 1) std::sort(hits.begin(), hits.end(), [](const Hit& a, const Hit& b) { return a.light < b.light; });
}

}  // namespace trace
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "filters/path_density/product_tree.h"
#include "formulas/path_density.glsl.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace gobo::pathdensity {

namespace {

constexpr uint32_t kLeafPoints = 24;

float productCoordinate(const MetricPoints& p, int axis, size_t i) {
  switch (axis) {
    case 0: return p.x[i];
    case 1: return p.y[i];
    case 2: return p.l[i];
    case 3: return p.a[i];
    default: return p.b[i];
  }
}
using formulas::productDistance;  // as distancesTo() has it, so that a bound is never beyond what it bounds

}  // namespace

struct ProductTree::Query {
  MetricPoint q;
  size_t self, k;
  float stretch;  // 1 + epsilon
  std::vector<Neighbour>& heap;
  size_t looked = 0;
  float furthest() const { return heap.size() < k ? std::numeric_limits<float>::infinity() : heap.front().distance; }
};

ProductTree::ProductTree(const MetricPoints& points) : points_(points), ids_(points.size()) {
  std::iota(ids_.begin(), ids_.end(), 0u);
  nodes_.reserve(ids_.size() / 8 + 1);
  if (!ids_.empty()) build(0, uint32_t(ids_.size()));
}

uint32_t ProductTree::build(uint32_t begin, uint32_t end) {
  const uint32_t at = uint32_t(nodes_.size());
  nodes_.emplace_back();
  Node node;
  node.begin = begin;
  node.end = end;
  int widest = 0;
  for (int axis = 0; axis < 5; ++axis) {
    node.lo[axis] = std::numeric_limits<float>::infinity();
    node.hi[axis] = -node.lo[axis];
    for (uint32_t i = begin; i < end; ++i) {
      const float v = productCoordinate(points_, axis, ids_[i]);
      node.lo[axis] = std::min(node.lo[axis], v);
      node.hi[axis] = std::max(node.hi[axis], v);
    }
    if (node.hi[axis] - node.lo[axis] > node.hi[widest] - node.lo[widest]) widest = axis;
  }
  if (end - begin > kLeafPoints) {
    const uint32_t middle = begin + (end - begin) / 2;
    std::nth_element(ids_.begin() + begin, ids_.begin() + middle, ids_.begin() + end, [&](uint32_t p, uint32_t q) {
      const float u = productCoordinate(points_, widest, p), v = productCoordinate(points_, widest, q);
      return u < v || (u == v && p < q);
    });
    build(begin, middle);
    node.right = build(middle, end);
  }
  nodes_[at] = node;
  return at;
}

float ProductTree::boundOf(const Node& n, const MetricPoint& q) {
  const auto away = [&](int axis, float v) { return std::max(std::max(n.lo[axis] - v, v - n.hi[axis]), 0.0f); };
  return productDistance(away(0, q.x), away(1, q.y), away(2, q.l), away(3, q.a), away(4, q.b));
}

void ProductTree::descend(uint32_t at, float bound, Query& query) const {
  // What ties with the furthest may have a lower index: only what is beyond it is left out.
  if (query.stretch * bound > query.furthest()) return;
  const Node& node = nodes_[at];
  if (node.right) {
    const uint32_t left = at + 1, right = node.right;
    const float toLeft = boundOf(nodes_[left], query.q), toRight = boundOf(nodes_[right], query.q);
    descend(toLeft <= toRight ? left : right, std::min(toLeft, toRight), query);
    descend(toLeft <= toRight ? right : left, std::max(toLeft, toRight), query);
    return;
  }
  for (uint32_t i = node.begin; i < node.end; ++i) {
    const uint32_t id = ids_[i];
    if (id == query.self) continue;
    ++query.looked;
    const MetricPoint p = pointAt(points_, id);
    const Neighbour found{productDistance(p.x - query.q.x, p.y - query.q.y, p.l - query.q.l, p.a - query.q.a, p.b - query.q.b), id};
    if (query.heap.size() == query.k) {
      if (!(found < query.heap.front())) continue;
      std::pop_heap(query.heap.begin(), query.heap.end());
      query.heap.pop_back();
    }
    query.heap.push_back(found);
    std::push_heap(query.heap.begin(), query.heap.end());
  }
}

size_t ProductTree::nearest(size_t i, int k, float epsilon, std::vector<Neighbour>& out) const {
  out.clear();
  Query query{pointAt(points_, i), i, size_t(k), 1.0f + epsilon, out};
  if (k > 0 && !nodes_.empty()) descend(0, 0.0f, query);
  std::sort_heap(out.begin(), out.end());
  return query.looked;
}

}  // namespace gobo::pathdensity

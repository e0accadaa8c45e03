// SPDX-License-Identifier: Apache-2.0
#include "trace/light_tree.h"

#include <algorithm>

#include "base/to_index.h"

namespace gobo {
inline namespace trace {

namespace {

struct Cone {
  Vec3 axis;
  float cosAngle;
};

// Smallest cone around two cones (pbrt-v4 DirectionCone Union); -1 means every direction.
Cone joinCones(const Cone& a, const Cone& b) {
  if (a.cosAngle <= -1.0f || b.cosAngle <= -1.0f) return {a.axis, -1.0f};
  const double ta = std::acos(std::clamp(double(a.cosAngle), -1.0, 1.0)), tb = std::acos(std::clamp(double(b.cosAngle), -1.0, 1.0));
  const double td = std::acos(std::clamp(double(glm::dot(a.axis, b.axis)), -1.0, 1.0));
  if (td + tb <= ta) return a;
  if (td + ta <= tb) return b;
  const double t = (ta + td + tb) / 2;
  if (t >= M_PI) return {a.axis, -1.0f};
  const Vec3 w = glm::cross(a.axis, b.axis);
  const float length = std::sqrt(glm::dot(w, w));
  if (!(length > 1e-6f)) return {a.axis, -1.0f};
  const double turn = t - ta;
  const Vec3 k = w / length;  // turn a.axis about k towards b.axis
  const Vec3 axis = a.axis * float(std::cos(turn)) + glm::cross(k, a.axis) * float(std::sin(turn));
  return {axis / std::sqrt(glm::dot(axis, axis)), float(std::cos(t)) - 1e-6f};
}

float sinOf(float c) { return std::sqrt(maxOf(1.0f - c * c, 0.0f)); }
// cos(max(0, a - b)) and sin of the same from sines and cosines.
float cosSub(float sinA, float cosA, float sinB, float cosB) { return cosA > cosB ? 1.0f : cosA * cosB + sinA * sinB; }
float sinSub(float sinA, float cosA, float sinB, float cosB) { return cosA > cosB ? 0.0f : sinA * cosB - cosA * sinB; }

// Surface area orientation heuristic: power x orientation measure x area (Conty & Kulla 2018, eq. 1).
double splitCost(const LightBounds& b, const Vec3& parentSize, int dim) {
  if (b.power <= 0.0f) return 0.0;
  const double to = std::acos(std::clamp(double(b.cosNormals), -1.0, 1.0)), te = std::acos(std::clamp(double(b.cosEmission), -1.0, 1.0));
  const double tw = std::min(to + te, M_PI), so = std::sin(to);
  const double omega = 2 * M_PI * (1 - std::cos(to)) + M_PI / 2 * (2 * tw * so - std::cos(to - 2 * tw) - 2 * to * so + std::cos(to));
  const Vec3 d = b.hi - b.lo;
  const double area = 2.0 * (double(d.x) * d.y + double(d.y) * d.z + double(d.z) * d.x);
  const double diagonal2 = double(glm::dot(d, d));
  const double k = std::max(parentSize.x, std::max(parentSize.y, parentSize.z)) / std::max(1e-30f, parentSize[dim]);
  return b.power * omega * k * (area + 1e-3 * diagonal2);  // the diagonal keeps collinear lights apart
}

}  // namespace

LightBounds LightBounds::join(const LightBounds& a, const LightBounds& b) {
  if (a.power <= 0.0f) return b;
  if (b.power <= 0.0f) return a;
  LightBounds o;
  o.lo = glm::min(a.lo, b.lo);
  o.hi = glm::max(a.hi, b.hi);
  const Cone c = joinCones({a.axis, a.cosNormals}, {b.axis, b.cosNormals});
  o.axis = c.axis;
  o.cosNormals = c.cosAngle;
  o.cosEmission = std::fmin(a.cosEmission, b.cosEmission);
  o.power = a.power + b.power;
  o.twoSided = a.twoSided || b.twoSided;
  return o;
}

LightTree::Cluster::Cluster(const LightBounds& b)
    : centre((b.lo + b.hi) * 0.5f),
      axis(b.axis),
      cosNormals(b.cosNormals),
      sinNormals(sinOf(b.cosNormals)),
      cosEmission(b.cosEmission),
      power(b.power),
      twoSided(b.twoSided),
      everywhere(b.cosNormals <= -1.0f && b.cosEmission <= 0.0f) {
  const Vec3 half = (b.hi - b.lo) * 0.5f;
  radius2 = glm::dot(half, half);
}

float LightBounds::importance(const Vec3& p, const Vec3* n) const { return LightTree::Cluster(*this).importance(p, n); }

inline float LightTree::Cluster::importance(const Vec3& p, const Vec3* n) const {
  if (!(power > 0.0f)) return 0.0f;
  const Vec3 toP = p - centre;
  const float true2 = glm::dot(toP, toP);
  const float d2 = maxOf(true2, maxOf(radius2, 1e-30f));  // inside the bounds distance says nothing
  float result = power / d2;
  if (true2 <= radius2 * 1.0001f) return result;    // any direction is possible: stay conservative
  const Vec3 wi = toP * (1.0f / std::sqrt(true2));  // from the lights to the receiver
  const float sinB2 = radius2 / true2, cosB = std::sqrt(maxOf(1.0f - sinB2, 0.0f)), sinB = std::sqrt(sinB2);
  if (!everywhere) {
    float cosW = glm::dot(axis, wi);
    if (twoSided) cosW = std::fabs(cosW);
    const float sinW = sinOf(cosW);
    const float cosX = cosSub(sinW, cosW, sinNormals, cosNormals), sinX = sinSub(sinW, cosW, sinNormals, cosNormals);
    const float cosP = cosSub(sinX, cosX, sinB, cosB);
    if (cosP <= cosEmission - 1e-4f) return 0.0f;
    result = power * maxOf(cosP, 1e-3f) / d2;  // the floor keeps rounding from excluding a grazing light
  }
  if (n) {
    const float cosI = -glm::dot(wi, *n), sinI = sinOf(cosI);
    const float cosIP = cosSub(sinI, cosI, sinB, cosB);
    if (cosIP < -1e-4f) return 0.0f;
    result *= maxOf(cosIP, 1e-3f);
  }
  return result;
}

void LightTree::build(const std::vector<LightBounds>& bounds, const StopToken& stop) {
  nodes_.clear();
  only_ = -1;
  root_ = LightBounds();
  leafOf_.assign(bounds.size(), -1);
  std::vector<int> order;
  for (size_t i = 0; i < bounds.size(); ++i)
    if (bounds[i].power > 0.0f) order.push_back(int(i));
  if (order.empty()) return;
  if (order.size() == 1) {
    only_ = order[0];
    root_ = bounds[only_];
    return;
  }
  nodes_.reserve(order.size() - 1);
  root_ = buildNode(bounds, order, 0, int(order.size()), -1, stop);
}

LightBounds LightTree::buildNode(const std::vector<LightBounds>& bounds, std::vector<int>& order, int begin, int end, int parent, const StopToken& stop) {
  if (end - begin > 64 && stop.stopRequested()) return {};
  const int self = int(nodes_.size());
  nodes_.emplace_back();
  nodes_[self].parent = parent;
  const auto centreOf = [&](int i) { return (bounds[i].lo + bounds[i].hi) * 0.5f; };
  Vec3 lo(3e38f), hi(-3e38f), blo(3e38f), bhi(-3e38f);
  for (int i = begin; i < end; ++i) {
    const Vec3 c = centreOf(order[i]);
    lo = glm::min(lo, c);
    hi = glm::max(hi, c);
    blo = glm::min(blo, bounds[order[i]].lo);
    bhi = glm::max(bhi, bounds[order[i]].hi);
  }
  constexpr int kBins = 12;
  double bestCost = 1e300;
  int bestDim = -1, bestBin = -1;
  const auto binOf = [&](int i, int dim) { return toIndex(kBins * ((centreOf(i)[dim] - lo[dim]) / (hi[dim] - lo[dim])), kBins); };
  for (int dim = 0; dim < 3; ++dim) {
    if (!(hi[dim] > lo[dim])) continue;
    LightBounds bins[kBins];
    for (int i = begin; i < end; ++i) {
      LightBounds& b = bins[binOf(order[i], dim)];
      b = LightBounds::join(b, bounds[order[i]]);
    }
    for (int cut = 1; cut < kBins; ++cut) {
      LightBounds below, above;
      for (int b = 0; b < cut; ++b) below = LightBounds::join(below, bins[b]);
      for (int b = cut; b < kBins; ++b) above = LightBounds::join(above, bins[b]);
      if (!(below.power > 0.0f) || !(above.power > 0.0f)) continue;
      const double cost = splitCost(below, bhi - blo, dim) + splitCost(above, bhi - blo, dim);
      if (cost < bestCost) {
        bestCost = cost;
        bestDim = dim;
        bestBin = cut;
      }
    }
  }
  int middle = (begin + end) / 2;  // all in one place: halve by index
  if (bestDim >= 0) {
    const auto it = std::stable_partition(order.begin() + begin, order.begin() + end, [&](int i) { return binOf(i, bestDim) < bestBin; });
    middle = int(it - order.begin());
    if (middle == begin || middle == end) middle = (begin + end) / 2;
  }
  LightBounds sides[2];
  for (int c = 0; c < 2; ++c) {
    const int from = c ? middle : begin, to = c ? end : middle, slot = 2 * self + c;
    if (to - from == 1) {
      nodes_[self].next[c] = ~order[from];
      leafOf_[order[from]] = slot;
      sides[c] = bounds[order[from]];
    } else {
      nodes_[self].next[c] = int(nodes_.size());
      sides[c] = buildNode(bounds, order, from, to, slot, stop);
    }
    nodes_[self].child[c] = Cluster(sides[c]);
  }
  return LightBounds::join(sides[0], sides[1]);
}

int LightTree::sample(const Vec3& p, const Vec3* n, float u, float& probability) const {
  probability = 1.0f;
  if (nodes_.empty()) return only_;
  int at = 0;
  while (at >= 0) {
    const Node& node = nodes_[at];
    const float l = node.child[0].importance(p, n), r = node.child[1].importance(p, n), sum = l + r;
    if (!(sum > 0.0f)) return -1;
    const float pl = l / sum;
    if (u < pl) {
      at = node.next[0];
      probability *= pl;
      u = u / pl;
    } else {
      at = node.next[1];
      probability *= 1.0f - pl;
      u = (u - pl) / (1.0f - pl);
    }
    u = minOf(u, 0x1.fffffep-1f);
  }
  return probability > 0.0f ? ~at : -1;
}

float LightTree::probability(const Vec3& p, const Vec3* n, int light) const {
  if (light == only_) return 1.0f;
  float product = 1.0f;
  int slot = leafOf_[light];
  if (slot < 0) return 0.0f;
  for (; slot >= 0; slot = nodes_[slot >> 1].parent) {
    const Node& node = nodes_[slot >> 1];
    const float l = node.child[0].importance(p, n), r = node.child[1].importance(p, n), sum = l + r;
    if (!(sum > 0.0f)) return 0.0f;
    const float pl = l / sum;
    product *= slot & 1 ? 1.0f - pl : pl;
  }
  return product;
}

}  // namespace trace
}  // namespace gobo

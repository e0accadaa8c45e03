// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/contour_tree.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace gobo {
inline namespace filters {

namespace {

constexpr uint32_t kLeaf = 4, kPollAbove = 4096;
constexpr double kFlat = 1e-2;   // spread of normals that counts as none at first
constexpr double kSlack = 1e-6;  // of angles: the cones are rounded, the segments' own test decides at their edges

/// Gauss rules on [-1, 1] by number of points, with the factor of their error: |rest| <= factor p (p+1) ... (p+2n-1) q^2n of length d^-p.
struct Rule {
  int points;
  double factor;
  double node[4], weight[4];
};
constexpr Rule kRules[3] = {
    {2, 3.7037e-3, {-0.57735026918962576, 0.57735026918962576, 0, 0}, {1, 1, 0, 0}},
    {3, 3.1746e-5, {-0.77459666924148338, 0, 0.77459666924148338, 0}, {0.55555555555555556, 0.88888888888888889, 0.55555555555555556, 0}},
    {4,
     1.4397e-7,
     {-0.86113631159405258, -0.33998104358485626, 0.33998104358485626, 0.86113631159405258},
     {0.34785484513745386, 0.65214515486254614, 0.65214515486254614, 0.34785484513745386}},
};

DVec3 middle(const ContourSegment& s) { return 0.5 * (DVec3(s.a) + DVec3(s.b)); }
double lengthOf(const ContourSegment& s) { return glm::length(DVec3(s.b) - DVec3(s.a)); }
double angleBetween(const Vec3& a, const Vec3& b) { return std::acos(std::clamp(glm::dot(DVec3(a), DVec3(b)), -1.0, 1.0)); }

double power(double x, int n) {
  double result = 1;
  for (; n > 0; n /= 2, x *= x)
    if (n % 2) result *= x;
  return result;
}

}  // namespace

ContourTree::Box ContourTree::boxOf(uint32_t first, uint32_t count) const {
  Box box;
  box.first = first;
  box.count = count;
  DVec3 sum(0.0), normals(0.0);
  double length = 0;
  for (uint32_t k = first; k < first + count; ++k) {
    const ContourSegment& s = segments_[order_[k]];
    const double l = lengthOf(s);
    sum += l * middle(s);
    normals += DVec3(s.normal);
    length += l;
  }
  PatchSources::Source& source = box.source;
  source.point = false;
  source.length = length;
  source.at = length > 0 ? sum / length : middle(segments_[order_[first]]);
  const double n = glm::length(normals);
  box.axis = n > 0 ? Vec3(normals / n) : segments_[order_[first]].normal;
  for (uint32_t k = first; k < first + count; ++k) {
    const ContourSegment& s = segments_[order_[k]];
    const double l = lengthOf(s) / (length > 0 ? length : 1.0);
    const DVec3 m = middle(s) - source.at, h = 0.5 * (DVec3(s.b) - DVec3(s.a));
    constexpr int kOf[6][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}};
    for (int i = 0; i < 6; ++i) source.moment[size_t(i)] += l * (m[kOf[i][0]] * m[kOf[i][1]] + h[kOf[i][0]] * h[kOf[i][1]] / 3.0);
    for (const Vec3& end : {s.a, s.b}) box.radius = std::max(box.radius, glm::length(DVec3(end) - source.at));
    box.angle = std::max(box.angle, angleBetween(box.axis, s.normal));
  }
  return box;
}

Result<ContourTree> ContourTree::build(std::span<const ContourSegment> segments, int p, double angle, double error, const StopToken& stop) {
  ContourTree tree;
  tree.segments_ = segments;
  tree.p_ = p;
  tree.angle_ = angle;
  tree.error_ = error;
  tree.surely_ = angle > 2 * kFlat ? std::cos(angle - 2 * kFlat) : 2;
  tree.hardly_ = angle + 2 * kFlat < M_PI ? std::cos(angle + 2 * kFlat) : -2;
  if (segments.empty()) return tree;
  tree.cubic_ = double(p) * (p + 1) * (p + 2) / 6;
  tree.safe_ = std::cbrt(0.5 * error / tree.cubic_);
  while (tree.rest(tree.safe_) > 0.5 * error) tree.safe_ *= 0.95;
  tree.order_.resize(segments.size());
  std::iota(tree.order_.begin(), tree.order_.end(), 0u);
  tree.boxes_.push_back(tree.boxOf(0, uint32_t(segments.size())));
  for (size_t at = 0; at < tree.boxes_.size(); ++at) {
    const Box box = tree.boxes_[at];
    if (box.count <= kLeaf) continue;
    if ((box.count > kPollAbove || at % kPollAbove == 0) && stop.stopRequested()) return Status(Code::Cancelled, "contour tree: stopped");
    DVec3 low(middle(segments[tree.order_[box.first]])), high = low;
    for (uint32_t k = box.first; k < box.first + box.count; ++k) {
      const DVec3 m = middle(segments[tree.order_[k]]);
      low = glm::min(low, m);
      high = glm::max(high, m);
    }
    const DVec3 size = high - low;
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    const auto from = tree.order_.begin() + box.first;
    std::nth_element(from, from + box.count / 2, from + box.count, [&](uint32_t a, uint32_t b) {
      const double u = middle(segments[a])[axis], v = middle(segments[b])[axis];
      return u != v ? u < v : a < b;
    });
    tree.boxes_[at].left = int(tree.boxes_.size());
    tree.boxes_.push_back(tree.boxOf(box.first, box.count / 2));
    tree.boxes_.push_back(tree.boxOf(box.first + box.count / 2, box.count - box.count / 2));
  }
  tree.length_ = tree.boxes_[0].source.length;
  return tree;
}

ContourTree::Seen ContourTree::seenFrom(const Patch& patch, const Box& box) const {
  const double spread = patch.angle + box.angle;
  if (spread < kFlat) {  // flat receivers: without an arc cosine a piece
    const double cosine = glm::dot(DVec3(patch.axis), DVec3(box.axis));
    if (cosine >= surely_) return Seen::All;
    if (cosine < hardly_) return Seen::None;
  }
  const double between = angleBetween(patch.axis, box.axis);
  if (between + spread <= angle_ - kSlack) return Seen::All;
  return between - spread > angle_ + kSlack ? Seen::None : Seen::Some;
}

/// A lower bound of the patch's sums, length * farthest^-p of the piece that gives most: of those on the way down to the nearest, taken for as far as they can
/// be.
ContourTree::Bound ContourTree::least(const Patch& patch) const {
  Bound most;
  double best = -HUGE_VAL;  // logarithm: the power leaves the range of double
  const auto distance = [&](const Box& box) { return glm::length(box.source.at - patch.centre); };
  for (int at = 0; at >= 0;) {
    const Box& box = boxes_[size_t(at)];
    const double farthest = distance(box) + box.radius + patch.radius;
    if (seenFrom(patch, box) == Seen::All && farthest > 0 && box.source.length > 0) {
      const double value = std::log(box.source.length) - p_ * std::log(farthest);
      if (value > best) best = value, most = {box.source.length, farthest};
    }
    if (box.left < 0) break;
    const Box &l = boxes_[size_t(box.left)], &r = boxes_[size_t(box.left) + 1];
    const bool left = seenFrom(patch, l) != Seen::None, right = seenFrom(patch, r) != Seen::None;
    at = left && (!right || distance(l) - l.radius <= distance(r) - r.radius) ? box.left : box.left + 1;
  }
  return most;
}

double ContourTree::rest(double q) const {
  if (q >= 1) return HUGE_VAL;
  if (q < 1e-3) return double(p_) * (p_ + 1) * (p_ + 2) / 6 * q * q * q * 1.2;  // the difference below would be of rounding; 1.2: p <= 64
  return 1 / power(1 - q, p_) - 1 - p_ * q - 0.5 * p_ * (p_ + 1) * q * q;
}

/// rest(q) <= most, mostly without rest's powers: a series of positive terms is at least its first.
bool ContourTree::whole(double q, double most) const { return cubic_ * q * q * q <= most && (q <= safe_ || rest(q) <= most); }

/// What a piece at distance d may be wrong by, in units of its length * d^-p.
double ContourTree::allowed(const Bound& bound, double d) const {
  return 0.5 * error_ * (1 + (bound.length > 0 ? bound.length / length_ * power(d / bound.farthest, p_) : 0.0));
}

void ContourTree::gatherSegment(const Patch& patch, uint32_t segment, const Bound& bound, PatchSources& out) const {
  const ContourSegment& s = segments_[segment];
  const DVec3 a(s.a), b(s.b);
  const double length = lengthOf(s);
  out.length += length;
  const double d = std::sqrt(squaredDistanceToSegment(patch.centre, a, b)) - patch.radius;
  if (d > 0) {
    const double q = 0.5 * length / d, most = allowed(bound, d);
    for (const Rule& rule : kRules) {
      double rest = rule.factor;
      for (int k = 0; k < 2 * rule.points; ++k) rest *= double(p_ + k) * q;
      if (!(rest <= most)) continue;
      for (int k = 0; k < rule.points; ++k) {
        PatchSources::Source point;
        point.at = 0.5 * (a + b) + 0.5 * rule.node[k] * (b - a);
        point.length = 0.5 * rule.weight[k] * length;
        out.sources.push_back(point);
      }
      return;
    }
  }
  out.near.push_back(segment);
}

void ContourTree::gather(const Patch& patch, const Pieces& pieces, PatchSources& out) const { gatherFrom(patch, pieces, 0, out, nullptr); }

void ContourTree::gatherFar(const Patch& patch, const Pieces& pieces, double distance, PatchSources& out, Pieces& rest) const {
  rest.clear();
  gatherFrom(patch, pieces, distance, out, &rest);
}

void ContourTree::gatherFrom(const Patch& patch, const Pieces& pieces, double distance, PatchSources& out, Pieces* rest) const {
  if (pieces.empty()) return;
  const Bound bound = least(patch);
  std::vector<int>& open = out.open;
  open.assign(pieces.rbegin(), pieces.rend());
  while (!open.empty()) {
    const int piece = open.back();
    const bool surely = piece < 0;
    const Box& box = boxes_[size_t(surely ? ~piece : piece)];
    open.pop_back();
    const Seen seen = surely ? Seen::All : seenFrom(patch, box);
    if (seen == Seen::None) continue;
    const double centre = glm::length(box.source.at - patch.centre), d = centre - patch.radius;
    const bool far = centre - box.radius >= distance;
    if (seen == Seen::All && far && d > box.radius && whole(box.radius / d, allowed(bound, d))) {
      out.sources.push_back(box.source);
      out.length += box.source.length;
      continue;
    }
    const int self = seen == Seen::All && !surely ? ~piece : piece;
    if (rest && ((!far && box.radius <= patch.radius) || (box.left < 0 && (!far || seen == Seen::Some)))) {
      rest->push_back(self);
      continue;
    }
    if (box.left >= 0) {
      open.push_back(seen == Seen::All ? ~(box.left + 1) : box.left + 1);
      open.push_back(seen == Seen::All ? ~box.left : box.left);
      continue;
    }
    const size_t near = out.near.size(), sources = out.sources.size();
    const double length = out.length;
    for (uint32_t k = box.first; k < box.first + box.count; ++k)
      if (seen == Seen::All) gatherSegment(patch, order_[k], bound, out);
      else out.guarded.push_back(order_[k]);
    if (rest && out.near.size() > near) {  // a leaf is taken apart by those that are nearer
      out.near.resize(near), out.sources.resize(sources), out.length = length;
      rest->push_back(self);
    }
  }
}

}  // namespace filters
}  // namespace gobo

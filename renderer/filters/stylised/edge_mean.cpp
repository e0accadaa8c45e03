// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/edge_mean.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "filters/stylised/contour.h"

namespace gobo {
inline namespace filters {

namespace {

constexpr size_t kLeafPoints = 8;
constexpr double kOpening = 0.3, kReach2 = 36.0;  // most radius over distance of a piece that counts as one; squared distance by that of the nearest
constexpr double kPieceError =
    1e-3;  // of all weights: what one piece may be wrong by; to second order q^2 p (p + 1) / 2 of its own for a radius of q distances

double fourth(double q) { return (q * q) * (q * q); }

/// Pieces of an edge, halved along their longest side.
class EdgeTree {
 public:
  explicit EdgeTree(std::vector<EdgePoint> points) : points_(std::move(points)) {
    if (points_.empty()) return;
    nodes_.reserve(2 * points_.size() / kLeafPoints + 2);
    build(0, points_.size());
  }

  using Values = std::array<double, kEdgeValues>;

  Values meanAt(const Vec3& x, const Vec3& n, float cosine, std::vector<uint32_t>& open) const {
    if (nodes_.empty()) return {};
    const DVec3 at(x);
    double nearest = std::numeric_limits<double>::max();
    visit(at, open, [&](const Node& node) {
      const double away = glm::length(node.centre - at) - node.radius;
      if (away > 0 && away * away >= nearest) return false;
      return each(node, [&](const EdgePoint& p) {
        const DVec3 r = DVec3(p.at) - at;
        if (glm::dot(p.normal, n) >= cosine) nearest = std::min(nearest, glm::dot(r, r));
      });
    });
    if (nearest == std::numeric_limits<double>::max()) return {};
    nearest = std::max(nearest, 1e-60);
    double weights = 0;
    Values sum{};
    const auto add = [&](double r2, double length, const auto& values) {
      const double w = length * fourth(nearest / std::max(r2, nearest));
      weights += w;
      for (size_t k = 0; k < kEdgeValues; ++k) sum[k] += w * double(values[k]);
    };
    visit(at, open, [&](const Node& node) {
      const double d = glm::length(node.centre - at), away = d - node.radius;
      if (away > 0 && away * away > kReach2 * nearest) return false;
      if (node.radius < kOpening * away && node.alike >= 0.999f && glm::dot(node.normal, n) >= cosine) {
        const double q = node.radius / away, w = node.length * fourth(nearest / (d * d));
        if (36.0 * q * q * w < kPieceError * weights) {
          add(d * d, node.length, node.values);
          return false;
        }
      }
      return each(node, [&](const EdgePoint& p) {
        const DVec3 r = DVec3(p.at) - at;
        if (glm::dot(p.normal, n) >= cosine) add(glm::dot(r, r), double(p.length), p.values);
      });
    });
    for (double& v : sum) v = weights > 0 ? v / weights : 0.0;
    return sum;
  }

 private:
  struct Node {
    DVec3 centre{0.0};
    Vec3 normal{0.0f};
    float alike = 0;  ///< least cosine between its normals and their mean
    double radius = 0, length = 0;
    Values values{};
    size_t begin = 0, end = 0;
    uint32_t right = 0;  ///< 0: a leaf; the left child is the next node
  };

  uint32_t build(size_t begin, size_t end) {
    const uint32_t self = uint32_t(nodes_.size());
    nodes_.emplace_back();
    Node node;
    node.begin = begin;
    node.end = end;
    DVec3 low(HUGE_VAL), high(-HUGE_VAL), normals(0.0);
    for (size_t k = begin; k < end; ++k) {
      const EdgePoint& p = points_[k];
      low = glm::min(low, DVec3(p.at));
      high = glm::max(high, DVec3(p.at));
      node.length += double(p.length);
      node.centre += double(p.length) * DVec3(p.at);
      for (size_t v = 0; v < kEdgeValues; ++v) node.values[v] += double(p.length) * double(p.values[v]);
      normals += DVec3(p.normal);
    }
    node.centre /= node.length;
    for (double& v : node.values) v /= node.length;
    const double n = glm::length(normals);
    node.normal = n > 0 ? Vec3(normals / n) : Vec3(0.0f);
    node.alike = 1;
    for (size_t k = begin; k < end; ++k) {
      node.radius = std::max(node.radius, glm::length(DVec3(points_[k].at) - node.centre));
      node.alike = std::min(node.alike, glm::dot(node.normal, points_[k].normal));
    }
    if (end - begin > kLeafPoints) {
      const DVec3 size = high - low;
      const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
      const size_t middle = begin + (end - begin) / 2;
      std::stable_sort(points_.begin() + ptrdiff_t(begin), points_.begin() + ptrdiff_t(end),
                       [axis](const EdgePoint& a, const EdgePoint& b) { return a.at[axis] < b.at[axis]; });
      build(begin, middle);
      node.right = build(middle, end);
    }
    nodes_[self] = node;
    return self;
  }

  /// `body` says whether a node is to be opened; of two children the nearer one comes first.
  template <typename Body>
  void visit(const DVec3& at, std::vector<uint32_t>& open, const Body& body) const {
    open.assign(1, 0);
    while (!open.empty()) {
      const uint32_t k = open.back();
      open.pop_back();
      if (!body(nodes_[k])) continue;
      const uint32_t left = k + 1, right = nodes_[k].right;
      const DVec3 l = nodes_[left].centre - at, r = nodes_[right].centre - at;
      const bool leftFirst = glm::dot(l, l) <= glm::dot(r, r);
      open.push_back(leftFirst ? right : left);
      open.push_back(leftFirst ? left : right);
    }
  }
  /// The points of a leaf. True: there are children instead.
  template <typename Body>
  bool each(const Node& node, const Body& body) const {
    if (node.right != 0) return true;
    for (size_t k = node.begin; k < node.end; ++k) body(points_[k]);
    return false;
  }

  std::vector<EdgePoint> points_;
  std::vector<Node> nodes_;
};

std::vector<EdgePoint> edgeOf(const ContourInput& in, std::span<const float> d, std::span<const uint32_t> caster, const EdgeMeanSettings& s, float cosine) {
  std::vector<EdgePoint> edge;
  const auto add = [&](size_t e, size_t f) {
    if (in.lit(e) == in.lit(f) || !onOneSurface(in, e, f, cosine)) return;
    const size_t shadowed = in.lit(e) ? f : e;
    const Vec3 step = in.at(in.P, f) - in.at(in.P, e), normal = in.at(in.N, e) + in.at(in.N, f);
    const float length = glm::length(step), n = glm::length(normal);
    if (d[shadowed] < 0.0f || !(length > 0.0f) || !(n > 0.0f)) return;
    EdgePoint p{in.at(in.P, e) + 0.5f * step, normal / n, length, {d[shadowed]}};
    for (size_t k = 0; k < s.casters.size(); ++k)
      p.values[k + 1] = std::binary_search(s.casters[k].begin(), s.casters[k].end(), caster[shadowed]) ? 1.0f : 0.0f;
    edge.push_back(p);
  };
  const size_t w = size_t(in.width);
  for (size_t y = 0; y < size_t(in.height); ++y)
    for (size_t x = 0; x < w; ++x) {
      const size_t e = y * w + x;
      if (x + 1 < w) add(e, e + 1);
      if (y + 1 < size_t(in.height)) add(e, e + w);
    }
  return edge;
}

class EdgeMeanNode final : public Node {
 public:
  explicit EdgeMeanNode(const EdgeMeanSettings& s) : s_(s) { GOBO_CHECK(s.casters.size() < kEdgeValues); }
  std::string type() const override { return "style_occluder"; }
  int version() const override { return 1; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override {
    h.add(s_.angle);
    for (const auto& set : s_.casters) {
      h.add("caster").add(uint64_t(set.size()));
      for (const uint32_t i : set) h.add(i);
    }
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 3);
    w.over(0, s_.extent).reads<float>(0, "d").reads<uint32_t>(0, "instance").over(1, s_.extent).reads<float>(1, "V", {1, 3}).over(2, s_.extent);
    w.reads<float>(2, "P", {3}).reads<float>(2, "N", {3}).reads<float>(2, "Ng", {3}).reads<float>(2, "footprint").reads<uint32_t>(2, "instance");
    TermShape shape{"style_occluder", Domain::ViewSample, s_.extent, {unsetPlane<float>("d")}};
    for (size_t k = 0; k < s_.casters.size(); ++k) shape.planes.push_back(unsetPlane<float>(edgeCasterPlane(int(k))));
    return w.gives(shape);
  }
  size_t workingBytes() const override { return size_t(s_.extent.width) * size_t(s_.extent.height) * 2 * (sizeof(EdgePoint) + 24); }
  Cost cost(const TermShape& result, uint32_t) const override { return {0.0, kReceiving * 500.0 * double(result.extent.elements())}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term &visibility = *ctx.inputs.at(1), &g = *ctx.inputs.at(2);
    const auto from = ctx.inputs.at(0)->floats("d");
    const auto caster = ctx.inputs.at(0)->plane<uint32_t>("instance");
    std::vector<std::span<float>> out{ctx.result->writable<float>("d")};
    for (size_t k = 0; k < s_.casters.size(); ++k) out.push_back(ctx.result->writable<float>(edgeCasterPlane(int(k))));
    const size_t count = size_t(s_.extent.width) * size_t(s_.extent.height);
    const float cosine = std::cos(s_.angle) - kRoundedCosine;
    for (size_t layer = 0; layer < size_t(s_.extent.layers); ++layer) {
      const ContourInput in = contourInput(visibility, g, layer);
      const EdgeTree tree(edgeOf(in, from.subspan(layer * count, count), caster.subspan(layer * count, count), s_, cosine));
      const bool complete = ctx.arena->parallelFor(
          size_t(in.height), 1,
          [&](size_t begin, size_t end) {
            std::vector<uint32_t> open;
            for (size_t e = begin * size_t(in.width); e < end * size_t(in.width); ++e) {
              const EdgeTree::Values means = in.valid(e) ? tree.meanAt(in.at(in.P, e), in.at(in.N, e), cosine, open) : EdgeTree::Values{};
              for (size_t k = 0; k < out.size(); ++k) out[k][layer * count + e] = float(means[k]);
            }
          },
          ctx.stop);
      if (!complete) return Status(Code::Cancelled, "style_occluder: stopped");
    }
    return TermPtr(ctx.result);
  }

 private:
  EdgeMeanSettings s_;
};

}  // namespace

double edgeMeanAt(const std::vector<EdgePoint>& edge, const Vec3& x, const Vec3& n, float cosine) {
  double nearest = HUGE_VAL, weights = 0, sum = 0;
  const auto seen = [&](const auto& body) {
    for (const EdgePoint& p : edge)
      if (glm::dot(p.normal, n) >= cosine) body(p, std::max(glm::dot(DVec3(p.at) - DVec3(x), DVec3(p.at) - DVec3(x)), 1e-60));
  };
  seen([&](const EdgePoint&, double r2) { nearest = std::min(nearest, r2); });
  seen([&](const EdgePoint& p, double r2) {
    weights += double(p.length) * fourth(nearest / r2), sum += double(p.length) * fourth(nearest / r2) * double(p.values[0]);
  });
  return weights > 0 ? sum / weights : 0.0;
}

const char* edgeCasterPlane(int caster) {
  static constexpr const char* names[kEdgeValues - 1] = {"caster0", "caster1", "caster2"};
  return names[size_t(caster)];
}

NodePtr makeEdgeMeanNode(const EdgeMeanSettings& settings) { return std::make_shared<EdgeMeanNode>(settings); }

}  // namespace filters
}  // namespace gobo

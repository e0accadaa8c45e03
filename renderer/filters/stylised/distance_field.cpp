// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/distance_field.h"

#include <algorithm>
#include <cmath>

#include "filters/stylised/contour_tree.h"
#include "filters/stylised/source_sums.h"
#include "formulas/math.glsl.h"

namespace gobo {

namespace {

constexpr int kSide = 8;  // of a patch
constexpr float kLeastDistance = 1e-30f;
static_assert(kSide * kSide == int(kPatchPoints));

/// averagedDistance() of one, by the float functions: pow() took longer than all sums.
float averaged(double sum, double length, double unit2, int p, StyleNorm norm, double constant) {
  const double unit = std::sqrt(unit2);
  const bool local = norm == StyleNorm::Local;
  const float ratio = float(local ? sum / (constant * unit) : sum / length);
  return float(unit) * formulas::fastExp(formulas::fastLog(ratio) * (-1.0f / float(local ? p - 1 : p)));
}

class StyleDistanceNode final : public Node {
 public:
  explicit StyleDistanceNode(const StyleDistanceSettings& s) : s_(s) { GOBO_CHECK(s.power >= 2 && s.power <= 64); }
  std::string type() const override { return "style_distance"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override {
    h.add(s_.power);
    h.add(int(s_.norm));
    h.add(s_.angle);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    w.over(0, s_.extent).reads<float>(0, "V", {1, 3}).over(1, s_.extent);
    w.reads<float>(1, "P", {3}).reads<float>(1, "N", {3}).reads<float>(1, "Ng", {3}).reads<float>(1, "footprint").reads<uint32_t>(1, "instance");
    return w.gives({"style_distance", Domain::ViewSample, s_.extent, {unsetPlane<float>("D")}});
  }
  size_t workingBytes() const override { return size_t(s_.extent.width) * size_t(s_.extent.height) * 2 * (2 * sizeof(ContourSegment) + 100); }
  Cost cost(const TermShape& result, uint32_t) const override { return {0.0, kReceiving * 150.0 * double(result.extent.elements())}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term &visibility = *ctx.inputs.at(0), &g = *ctx.inputs.at(1);
    const auto D = ctx.result->writable<float>("D");
    const size_t count = size_t(s_.extent.width) * size_t(s_.extent.height);
    for (size_t layer = 0; layer < size_t(s_.extent.layers); ++layer) {
      ContourInput in;
      in.width = s_.extent.width;
      in.height = s_.extent.height;
      in.channels = visibility.channels("V");
      in.V = visibility.floats("V").subspan(layer * count * size_t(in.channels), count * size_t(in.channels));
      in.P = g.floats("P").subspan(layer * count * 3, count * 3);
      in.N = g.floats("N").subspan(layer * count * 3, count * 3);
      in.Ng = g.floats("Ng").subspan(layer * count * 3, count * 3);
      in.footprint = g.floats("footprint").subspan(layer * count, count);
      in.instance = g.plane<uint32_t>("instance").subspan(layer * count, count);
      GOBO_TRY(runLayer(ctx, in, D.subspan(layer * count, count)));
    }
    return TermPtr(ctx.result);
  }

 private:
  Status runLayer(const RunContext& ctx, const ContourInput& in, std::span<float> D) const {
    const float cosine = std::cos(s_.angle);
    GOBO_ASSIGN(const std::vector<ContourSegment> contour, extractContour(in, cosine, *ctx.arena, ctx.stop));
    GOBO_ASSIGN(const ContourTree tree, ContourTree::build(contour, s_.power, double(s_.angle), kFieldError * (s_.power - 1), ctx.stop));
    const double constant = straightLineConstant(s_.power);
    const int across = (in.width + kSide - 1) / kSide, down = (in.height + kSide - 1) / kSide;
    const bool complete = ctx.arena->parallelFor(
        size_t(across) * size_t(down), 4,
        [&](size_t begin, size_t end) {
          PatchSources sources;
          for (size_t k = begin; k < end; ++k) runPatch(in, tree, int(k % size_t(across)) * kSide, int(k / size_t(across)) * kSide, cosine, constant, sources, D);
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "style_distance: stopped");
    return {};
  }

  void runPatch(const ContourInput& in, const ContourTree& tree, int x0, int y0, float cosine, double constant, PatchSources& sources, std::span<float> D) const {
    PatchPoints points;
    size_t at[kPatchPoints];
    DVec3 low(HUGE_VAL), high(-HUGE_VAL), normals(0.0);
    for (int y = y0; y < std::min(y0 + kSide, in.height); ++y)
      for (int x = x0; x < std::min(x0 + kSide, in.width); ++x) {
        const size_t e = size_t(y) * size_t(in.width) + size_t(x);
        D[e] = kStyleFar;
        if (!in.valid(e)) continue;
        const DVec3 P(in.at(in.P, e));
        low = glm::min(low, P);
        high = glm::max(high, P);
        normals += DVec3(in.at(in.N, e));
        points.x[points.count] = P.x, points.y[points.count] = P.y, points.z[points.count] = P.z;
        at[points.count++] = e;
      }
    if (points.count == 0) return;
    for (size_t k = points.count; k < kPatchPoints; ++k) points.x[k] = points.x[0], points.y[k] = points.y[0], points.z[k] = points.z[0];
    Patch patch;
    patch.centre = 0.5 * (low + high);
    const double n = glm::length(normals);
    patch.axis = n > 0 ? Vec3(normals / n) : in.at(in.N, at[0]);
    for (size_t k = 0; k < points.count; ++k) {
      patch.radius = std::max(patch.radius, glm::length(DVec3(points.x[k], points.y[k], points.z[k]) - patch.centre));
      patch.angle = std::max(patch.angle, std::acos(std::clamp(double(glm::dot(patch.axis, in.at(in.N, at[k]))), -1.0, 1.0)));
    }
    sources.clear();
    tree.gather(patch, sources);

    for (size_t k = 0; k < kPatchPoints; ++k) points.nearest2[k] = HUGE_VAL, points.sum[k] = 0;
    nearestSources(sources.sources, points);
    double length[kPatchPoints];
    for (size_t k = 0; k < points.count; ++k) {
      length[k] = sources.length;
      eachSegment(in, tree, sources, points, k, at[k], cosine, [&](const DVec3& x, const ContourSegment& s, bool guarded) {
        points.nearest2[k] = std::min(points.nearest2[k], squaredDistanceToSegment(x, DVec3(s.a), DVec3(s.b)));
        if (guarded) length[k] += glm::length(DVec3(s.b) - DVec3(s.a));
      });
    }
    // A point on the contour: what its sum would be says nothing, and D is 0.
    bool on[kPatchPoints] = {};
    for (size_t k = 0; k < kPatchPoints; ++k)
      if (!(points.nearest2[k] > 0) || k >= points.count) on[k] = k < points.count, points.nearest2[k] = 1;
    const bool any = !sources.sources.empty();
    if (any) addSources(sources.sources, s_.power, points);
    for (size_t k = 0; k < points.count; ++k) {
      float d = kStyleFar;
      if (on[k]) d = 0;
      else if (std::isfinite(points.nearest2[k])) {
        eachSegment(in, tree, sources, points, k, at[k], cosine, [&](const DVec3& x, const ContourSegment& s, bool) {
          points.sum[k] += inversePowerIntegral(x, DVec3(s.a), DVec3(s.b), s_.power, points.nearest2[k]);
        });
        d = averaged(points.sum[k], length[k], points.nearest2[k], s_.power, s_.norm, constant);
      }
      d = std::clamp(std::isfinite(d) ? d : kStyleFar, kLeastDistance, kStyleFar);
      D[at[k]] = in.lit(at[k]) ? d : -d;
    }
  }

  template <typename Body>
  static void eachSegment(const ContourInput& in, const ContourTree& tree, const PatchSources& sources, const PatchPoints& points, size_t k, size_t e, float cosine,
                          const Body& body) {
    const DVec3 x(points.x[k], points.y[k], points.z[k]);
    for (const uint32_t s : sources.near) body(x, tree.segments()[s], false);
    if (sources.guarded.empty()) return;
    const Vec3 n = in.at(in.N, e);
    for (const uint32_t s : sources.guarded)
      if (glm::dot(tree.segments()[s].normal, n) >= cosine) body(x, tree.segments()[s], true);
  }

  StyleDistanceSettings s_;
};

}  // namespace

NodePtr makeStyleDistanceNode(const StyleDistanceSettings& settings) { return std::make_shared<StyleDistanceNode>(settings); }

}  // namespace gobo

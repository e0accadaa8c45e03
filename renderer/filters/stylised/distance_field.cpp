// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/distance_field.h"

#include <algorithm>
#include <cmath>
#include <limits>

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
          Scratch scratch;
          for (size_t k = begin; k < end; ++k)
            runPatch(in, tree, int(k % size_t(across)) * kSide, int(k / size_t(across)) * kSide, cosine, constant, scratch, D);
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "style_distance: stopped");
    return {};
  }

  struct Scratch {
    PatchSources found;
    std::vector<PatchSource> sources;
  };

  void runPatch(const ContourInput& in, const ContourTree& tree, int x0, int y0, float cosine, double constant, Scratch& scratch, std::span<float> D) const {
    DVec3 at[kPatchPoints];
    size_t element[kPatchPoints], count = 0;
    DVec3 low(HUGE_VAL), high(-HUGE_VAL), normals(0.0);
    for (int y = y0; y < std::min(y0 + kSide, in.height); ++y)
      for (int x = x0; x < std::min(x0 + kSide, in.width); ++x) {
        const size_t e = size_t(y) * size_t(in.width) + size_t(x);
        D[e] = kStyleFar;
        if (!in.valid(e)) continue;
        at[count] = DVec3(in.at(in.P, e));
        low = glm::min(low, at[count]);
        high = glm::max(high, at[count]);
        normals += DVec3(in.at(in.N, e));
        element[count++] = e;
      }
    if (count == 0) return;
    Patch patch;
    patch.centre = 0.5 * (low + high);
    const double n = glm::length(normals);
    patch.axis = n > 0 ? Vec3(normals / n) : in.at(in.N, element[0]);
    for (size_t k = 0; k < count; ++k) {
      patch.radius = std::max(patch.radius, glm::length(at[k] - patch.centre));
      patch.angle = std::max(patch.angle, std::acos(std::clamp(double(glm::dot(patch.axis, in.at(in.N, element[k]))), -1.0, 1.0)));
    }
    PatchSources& found = scratch.found;
    found.clear();
    tree.gather(patch, found);
    const auto eachSegment = [&](size_t k, const auto& body) {
      for (const uint32_t s : found.near) body(tree.segments()[s], false);
      for (const uint32_t s : found.guarded)
        if (glm::dot(tree.segments()[s].normal, in.at(in.N, element[k])) >= cosine) body(tree.segments()[s], true);
    };

    double unit = HUGE_VAL;
    for (const PatchSources::Source& s : found.sources) unit = std::min(unit, glm::length(s.at - patch.centre));
    const bool far = !found.sources.empty();
    if (!far) unit = 1;
    PatchPoints points;
    scratch.sources.clear();
    for (const PatchSources::Source& s : found.sources) scratch.sources.push_back(patchSource(s, patch.centre, unit));
    for (size_t k = 0; k < kPatchPoints; ++k) {
      const DVec3 p = (at[std::min(k, count - 1)] - patch.centre) / unit;
      points.x[k] = float(p.x), points.y[k] = float(p.y), points.z[k] = float(p.z);
      points.nearest2[k] = std::numeric_limits<float>::max();
      points.sum[k] = 0;
    }
    nearestSources(scratch.sources, points);
    double nearest2[kPatchPoints], length[kPatchPoints];
    for (size_t k = 0; k < count; ++k) {
      nearest2[k] = far ? double(points.nearest2[k]) * unit * unit : HUGE_VAL;
      length[k] = found.length;
      eachSegment(k, [&](const ContourSegment& s, bool guarded) {
        nearest2[k] = std::min(nearest2[k], squaredDistanceToSegment(at[k], DVec3(s.a), DVec3(s.b)));
        if (guarded) length[k] += glm::length(DVec3(s.b) - DVec3(s.a));
      });
      // Far sources count for nothing beside a contour that is closer by more than float can say.
      points.nearest2[k] = std::max(float(std::min(nearest2[k] / (unit * unit), 1e30)), std::numeric_limits<float>::min());
    }
    if (far) addSources(scratch.sources, s_.power, points);
    for (size_t k = 0; k < count; ++k) {
      float d = kStyleFar;
      if (!(nearest2[k] > 0)) d = 0;
      else if (std::isfinite(nearest2[k])) {
        double sum = far ? double(points.sum[k]) * unit : 0.0;
        eachSegment(k, [&](const ContourSegment& s, bool) { sum += inversePowerIntegral(at[k], DVec3(s.a), DVec3(s.b), s_.power, nearest2[k]); });
        d = averaged(sum, length[k], nearest2[k], s_.power, s_.norm, constant);
      }
      d = std::clamp(std::isfinite(d) ? d : kStyleFar, kLeastDistance, kStyleFar);
      D[element[k]] = in.lit(element[k]) ? d : -d;
    }
  }

  StyleDistanceSettings s_;
};

}  // namespace

NodePtr makeStyleDistanceNode(const StyleDistanceSettings& settings) { return std::make_shared<StyleDistanceNode>(settings); }

}  // namespace gobo

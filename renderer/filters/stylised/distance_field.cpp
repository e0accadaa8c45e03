// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/distance_field.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "filters/stylised/contour_tree.h"
#include "filters/stylised/hidden_contours.h"
#include "filters/stylised/source_sums.h"

namespace gobo {

namespace {

constexpr int kSide = 8, kBlock = 4;    // samples of a patch, patches of a block, each way
constexpr size_t kGroups = 8;           // most surfaces of a patch that are told apart
constexpr size_t kFarSources = 80;      // most for which a patch of patches is not cut
constexpr double kMostApart = 1e6;      // of the nearest source: what is farther adds a millionth at most, and powers of it leave a float's range
constexpr float kAlike = 0.9f;          // least cosine between normals of a group
constexpr float kReachOfGroup = 64.0f;  // widths of a pixel
constexpr double kSpread = 1e20;        // farthest by nearest to the power p up to which one unit does for all points
static_assert(kSide * kSide == int(kPatchPoints));

/// Samples of a patch that lie on one surface, more or less: those beyond a silhouette would make its ball hundreds of times as large.
struct Group {
  Patch patch;
  size_t count = 0;
  uint32_t element[kPatchPoints];
};
struct Groups {
  size_t count = 0;
  Group group[kGroups];
};

double angleOf(const Vec3& a, const Vec3& b) { return std::acos(std::clamp(double(glm::dot(a, b)), -1.0, 1.0)); }

void bound(const ContourInput& in, Group& g) {
  DVec3 low(HUGE_VAL), high(-HUGE_VAL), normals(0.0);
  for (size_t k = 0; k < g.count; ++k) {
    const DVec3 P(in.at(in.P, g.element[k]));
    low = glm::min(low, P);
    high = glm::max(high, P);
    normals += DVec3(in.at(in.N, g.element[k]));
  }
  g.patch.centre = 0.5 * (low + high);
  const double n = glm::length(normals);
  g.patch.axis = n > 0 ? Vec3(normals / n) : in.at(in.N, g.element[0]);
  double radius2 = 0;
  float least = 1;
  for (size_t k = 0; k < g.count; ++k) {
    const DVec3 r = DVec3(in.at(in.P, g.element[k])) - g.patch.centre;
    radius2 = std::max(radius2, glm::dot(r, r));
    least = std::min(least, glm::dot(g.patch.axis, in.at(in.N, g.element[k])));
  }
  g.patch.radius = std::sqrt(radius2);
  g.patch.angle = std::acos(double(std::max(least, -1.0f)));
}

void groupsOf(const ContourInput& in, int x0, int y0, Groups& all) {
  all.count = 0;
  size_t last = 0;
  for (int y = y0; y < std::min(y0 + kSide, in.height); ++y)
    for (int x = x0; x < std::min(x0 + kSide, in.width); ++x) {
      const size_t e = size_t(y) * size_t(in.width) + size_t(x);
      if (!in.valid(e)) continue;
      const auto alike = [&](const Group& g) {
        const size_t f = g.element[0];
        const Vec3 step = in.at(in.P, e) - in.at(in.P, f);
        const float reach = kReachOfGroup * std::max(in.footprint[e], in.footprint[f]);
        return in.instance[e] == in.instance[f] && glm::dot(in.at(in.N, e), in.at(in.N, f)) >= kAlike && glm::dot(step, step) <= reach * reach;
      };
      if (all.count == 0 || !alike(all.group[last]))
        for (last = 0; last < all.count && !alike(all.group[last]);) ++last;
      if (last == kGroups) last = kGroups - 1;
      Group& g = all.group[last];
      if (last == all.count) g.count = 0, ++all.count;
      g.element[g.count++] = uint32_t(e);
    }
  for (size_t k = 0; k < all.count; ++k) bound(in, all.group[k]);
}

class StyleDistanceNode final : public Node {
 public:
  explicit StyleDistanceNode(const StyleDistanceSettings& s) : s_(s) {
    GOBO_CHECK(s.power >= 2 && s.power <= 64);
    GOBO_CHECK(s.level >= 0 && s.level < s.levels);
  }
  std::string type() const override { return "style_distance"; }
  int version() const override { return 2; }  // 2: patches by surface, segments in float
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override { s_.hash(h); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2 + 2 * size_t(s_.hidden));
    readsContour(w, s_.extent);
    readsHiddenContours(w, s_.extent, s_.hidden);
    return w.gives({"style_distance", Domain::ViewSample, s_.extent, {unsetPlane<float>("D")}});
  }
  size_t workingBytes() const override { return size_t(1 + s_.hidden) * size_t(s_.extent.width) * size_t(s_.extent.height) * 2 * (2 * sizeof(ContourSegment) + 100); }
  Cost cost(const TermShape& result, uint32_t) const override { return {0.0, kReceiving * 150.0 * double(result.extent.elements())}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term &visibility = *ctx.inputs.at(0), &g = *ctx.inputs.at(1);
    const auto D = ctx.result->writable<float>("D");
    const size_t count = size_t(s_.extent.width) * size_t(s_.extent.height);
    for (size_t layer = 0; layer < size_t(s_.extent.layers); ++layer) {
      GOBO_TRY(runLayer(ctx, contourInput(visibility, g, layer, s_.level, s_.levels), layer, D.subspan(layer * count, count)));
    }
    return TermPtr(ctx.result);
  }

 private:
  Status runLayer(const RunContext& ctx, const ContourInput& in, size_t view, std::span<float> D) const {
    const float cosine = std::cos(s_.angle) - kRoundedCosine;
    GOBO_ASSIGN(std::vector<ContourSegment> contour, extractContour(in, cosine, *ctx.arena, ctx.stop));
    GOBO_TRY(appendHiddenContours(ctx, in, view, s_.hidden, cosine, contour));
    GOBO_ASSIGN(const ContourTree tree, ContourTree::build(contour, s_.power, double(s_.angle), kFieldError * (s_.power - 1), ctx.stop));
    const double constant = straightLineConstant(s_.power);
    constexpr int kStep = kSide * kBlock;
    const int across = (in.width + kStep - 1) / kStep, down = (in.height + kStep - 1) / kStep;
    const bool complete = ctx.arena->parallelFor(
        size_t(across) * size_t(down), 1,
        [&](size_t begin, size_t end) {
          const auto scratch = std::make_unique<Scratch>();
          for (size_t k = begin; k < end; ++k) {
            const int x0 = int(k % size_t(across)) * kStep, y0 = int(k / size_t(across)) * kStep;
            for (int y = y0; y < std::min(y0 + kStep, in.height); ++y)
              std::fill_n(&D[size_t(y) * size_t(in.width) + size_t(x0)], std::min(kStep, in.width - x0), kStyleFar);
            for (int j = 0; j < kBlock; ++j)
              for (int i = 0; i < kBlock; ++i) groupsOf(in, x0 + i * kSide, y0 + j * kSide, scratch->groups[j][i]);
            runPatches({in, tree, cosine, constant, D, ctx.stop}, 0, 0, kBlock, *scratch);
          }
        },
        ctx.stop);
    if (!complete || ctx.stop.stopRequested()) return Status(Code::Cancelled, "style_distance: stopped");
    return {};
  }

  struct Layer {
    const ContourInput& in;
    const ContourTree& tree;
    float cosine;
    double constant;
    std::span<float> D;
    const StopToken& stop;
  };
  struct Scratch {
    Groups groups[kBlock][kBlock];
    PatchSources found;
    std::vector<PatchSource> sources;
    std::vector<NearSegment> segments;
  };

  /// The ball and cone about those of side x side patches; false where some patch has more than one surface.
  static bool around(const Scratch& scratch, int i0, int j0, int side, Patch& all) {
    DVec3 low(HUGE_VAL), high(-HUGE_VAL), axes(0.0);
    const auto each = [&](const auto& body) {
      for (int j = j0; j < j0 + side; ++j)
        for (int i = i0; i < i0 + side; ++i)
          if (scratch.groups[j][i].count == 1) body(scratch.groups[j][i].group[0].patch);
          else if (scratch.groups[j][i].count > 1) return false;
      return true;
    };
    if (!each([&](const Patch& p) { low = glm::min(low, p.centre), high = glm::max(high, p.centre), axes += DVec3(p.axis); })) return false;
    const double n = glm::length(axes);
    if (!(n > 0)) return false;
    all.centre = 0.5 * (low + high);
    all.axis = Vec3(axes / n);
    each([&](const Patch& p) {
      all.radius = std::max(all.radius, glm::length(p.centre - all.centre) + p.radius);
      all.angle = std::max(all.angle, angleOf(all.axis, p.axis) + p.angle);
    });
    return true;
  }

  /// What is far from all of them is gathered once; else quarters, down to the surfaces of one patch.
  void runPatches(const Layer& layer, int i0, int j0, int side, Scratch& scratch) const {
    if (layer.stop.stopRequested()) return;  // a patch may see every segment of a noisy shadow
    if (side == 1) {
      const Groups& groups = scratch.groups[j0][i0];
      for (size_t k = 0; k < groups.count; ++k) {
        scratch.found.clear();
        layer.tree.gather(groups.group[k].patch, scratch.found);
        const double unit = prepare(layer, groups.group[k].patch, scratch);
        runGroup(layer, groups.group[k], groups.group[k].patch, unit, scratch);
      }
      return;
    }
    Patch all;
    scratch.found.clear();
    if (around(scratch, i0, j0, side, all) && layer.tree.gatherFar(all, kFarSources, scratch.found)) {
      const double unit = prepare(layer, all, scratch);
      for (int j = j0; j < j0 + side; ++j)
        for (int i = i0; i < i0 + side; ++i)
          if (scratch.groups[j][i].count == 1) runGroup(layer, scratch.groups[j][i].group[0], all, unit, scratch);
      return;
    }
    const int half = side / 2;
    for (int j = j0; j < j0 + side; j += half)
      for (int i = i0; i < i0 + side; i += half) runPatches(layer, i, j, half, scratch);
  }

  /// Sources and segments about the patch's centre; the unit of the sources: the nearest one's distance.
  static double prepare(const Layer& layer, const Patch& patch, Scratch& scratch) {
    const PatchSources& found = scratch.found;
    double unit = HUGE_VAL;
    for (const PatchSources::Source& s : found.sources) unit = std::min(unit, glm::length(s.at - patch.centre));
    if (found.sources.empty()) unit = 1;
    scratch.sources.clear();
    for (const PatchSources::Source& s : found.sources)
      if (glm::length(s.at - patch.centre) <= kMostApart * unit) scratch.sources.push_back(patchSource(s, patch.centre, unit));
    scratch.segments.clear();
    const auto add = [&](uint32_t segment, float cosine) {
      const ContourSegment& s = layer.tree.segments()[segment];
      const DVec3 a = DVec3(s.a) - patch.centre, along = DVec3(s.b) - DVec3(s.a);
      const double length = glm::length(along);
      if (!(length > 0)) return;
      const DVec3 u = along / length;
      scratch.segments.push_back({a.x, a.y, a.z, u.x, u.y, u.z, length, s.normal.x, s.normal.y, s.normal.z, cosine});
    };
    for (const uint32_t s : found.near) add(s, -2.0f);
    for (const uint32_t s : found.guarded) add(s, layer.cosine);
    return unit;
  }

  void runGroup(const Layer& layer, const Group& group, const Patch& patch, double unit, Scratch& scratch) const {
    const ContourInput& in = layer.in;
    const bool far = !scratch.sources.empty(), near = !scratch.segments.empty();
    PatchPoints points;
    NearPoints close;
    points.lanes = close.lanes = (group.count + kLanes - 1) / kLanes * kLanes;
    for (size_t k = 0; k < points.lanes; ++k) {
      const size_t e = group.element[std::min(k, group.count - 1)];
      const DVec3 p = DVec3(in.at(in.P, e)) - patch.centre, q = p / unit;
      const Vec3 n = in.at(in.N, e);
      points.x[k] = float(q.x), points.y[k] = float(q.y), points.z[k] = float(q.z);
      points.nearest2[k] = std::numeric_limits<float>::max();
      points.sum[k] = 0;
      close.x[k] = p.x, close.y[k] = p.y, close.z[k] = p.z;
      close.nx[k] = n.x, close.ny[k] = n.y, close.nz[k] = n.z;
      close.length[k] = scratch.found.length;
      close.sum[k] = 0;
    }
    const double within = patch.radius / unit;
    if (far && !near && within < 0.9 && s_.power * std::log((1 + within) / (1 - within)) < std::log(kSpread))
      std::fill_n(points.nearest2, points.lanes, float((1 - within) * (1 - within)));
    else nearestSources(scratch.sources, points);
    for (size_t k = 0; k < points.lanes; ++k) close.nearest2[k] = far ? double(points.nearest2[k]) * unit * unit : HUGE_VAL;
    if (near) {
      nearestSegments(scratch.segments, close);
      // Far sources count for nothing beside a contour that is closer by more than float can say.
      for (size_t k = 0; k < points.lanes; ++k)
        points.nearest2[k] = std::max(float(std::min(close.nearest2[k] / (unit * unit), 1e30)), std::numeric_limits<float>::min());
      addSegments(scratch.segments, s_.power, close);
    }
    if (far) addSources(scratch.sources, s_.power, points);
    const bool local = s_.norm == StyleNorm::Local;
    float ratio[kPatchPoints], scale[kPatchPoints] = {}, d[kPatchPoints];
    for (size_t k = 0; k < points.lanes; ++k) {
      const double width = std::sqrt(close.nearest2[k]), sum = double(points.sum[k]) * unit + close.sum[k];
      scale[k] = float(width);
      ratio[k] = float(local ? sum / (layer.constant * width) : sum / close.length[k]);
    }
    powers(ratio, -1.0f / float(local ? s_.power - 1 : s_.power), points.lanes, d);
    for (size_t k = 0; k < group.count; ++k) {
      const double n2 = close.nearest2[k];
      float value = !(n2 > 0) ? 0.0f : n2 == HUGE_VAL ? kStyleFar : d[k] * scale[k];
      value = std::clamp(std::isfinite(value) ? value : kStyleFar, kLeastStyleDistance, kStyleFar);
      layer.D[group.element[k]] = in.lit(group.element[k]) ? value : -value;
    }
  }

  StyleDistanceSettings s_;
};

}  // namespace

void StyleDistanceSettings::hash(Hasher& h) const {
  h.add(power);
  h.add(int(norm));
  h.add(angle);
  if (levels > 1) h.add("level").add(level).add(levels);
  if (hidden > 0) h.add("hidden").add(hidden);
}

void readsContour(Wiring& w, const Extent& extent) {
  w.over(0, extent).reads<float>(0, "V", {1, 3}).over(1, extent);
  w.reads<float>(1, "P", {3}).reads<float>(1, "N", {3}).reads<float>(1, "Ng", {3}).reads<float>(1, "footprint").reads<uint32_t>(1, "instance");
}

NodePtr makeStyleDistanceNode(const StyleDistanceSettings& settings) { return std::make_shared<StyleDistanceNode>(settings); }

}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/distance_field.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>

#include "filters/stylised/contour_tree.h"
#include "filters/stylised/hidden_contours.h"
#include "filters/stylised/screen_metric.h"
#include "filters/stylised/source_sums.h"

namespace gobo {
inline namespace filters {

namespace {

constexpr int kSide = 8, kBlock = 4;     // samples of a patch, patches of a block, each way
constexpr size_t kGroups = 8;            // most surfaces of a patch that are told apart
constexpr size_t kFarSources = 80;       // most for which a patch of patches that is not flat is not cut
constexpr double kFarFrom = 2.0;         // radii of such a one from the nearest piece, from where its sources are few
constexpr double kOffPlane = 2e-5;       // most that points of a plane are off it, by the distance of what is interpolated on it
constexpr double kInterpolation = 0.25;  // share of interpolation in the error
constexpr double kMostApart = 1e6;       // of the nearest source: what is farther adds a millionth at most, and powers of it leave a float's range
constexpr float kAlike = 0.9f;           // least cosine between normals of a group
constexpr float kReachOfGroup = 64.0f;   // widths of a pixel
constexpr double kSpread = 1e20;         // farthest by nearest to the power p up to which one unit does for all points
static_assert(kSide * kSide == int(kPatchPoints));

/// Samples of a patch that lie on one surface, more or less: those beyond a silhouette would make its ball hundreds of times as large.
struct Group {
  Patch patch;
  size_t count = 0;
  uint32_t element[kPatchPoints];
  double off = HUGE_VAL;  ///< most that a point is off the plane of the corners; unknown if not all of the patch is here
  DVec3 corner[3];
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
  g.off = HUGE_VAL;
}

/// A whole patch of one surface, the usual one: bounds of its points, and how flat it is. False: it is another.
bool boundWhole(const ContourInput& in, int x0, int y0, Group& g) {
  if (x0 + kSide > in.width || y0 + kSide > in.height) return false;
  SurfacePatch p;
  for (size_t k = 0; k < kPatchPoints; ++k) {
    const size_t e = (size_t(y0) + k / kSide) * size_t(in.width) + size_t(x0) + k % kSide;
    const Vec3 P = in.at(in.P, e), N = in.at(in.N, e);
    p.x[k] = P.x, p.y[k] = P.y, p.z[k] = P.z, p.nx[k] = N.x, p.ny[k] = N.y, p.nz[k] = N.z;
    p.width[k] = in.footprint[e];
    p.id[k] = in.instance[e];
    g.element[k] = uint32_t(e);
  }
  // cppcheck-suppress uninitvar ; the loop has written all of it
  if (!isOneSurface(p, kAlike, kReachOfGroup)) return false;
  g.count = kPatchPoints;
  const Vec3 origin(0.0f), ex(1, 0, 0), ey(0, 1, 0), ez(0, 0, 1);
  const Span x = spanAlong(p, origin, ex), y = spanAlong(p, origin, ey), z = spanAlong(p, origin, ez);
  g.patch.centre = 0.5 * (DVec3(x.low, y.low, z.low) + DVec3(x.high, y.high, z.high));
  DVec3 normals(0.0);
  for (size_t k = 0; k < kPatchPoints; ++k) normals += DVec3(p.nx[k], p.ny[k], p.nz[k]);
  const double length = glm::length(normals);
  g.patch.axis = length > 0 ? Vec3(normals / length) : Vec3(p.nx[0], p.ny[0], p.nz[0]);
  float farthest2 = 0, least = 1;
  const Vec3 centre(g.patch.centre);
  boundsOf(p, centre, g.patch.axis, farthest2, least);
  g.patch.radius = std::sqrt(double(farthest2)) * (1 + 1e-6) + glm::length(g.patch.centre - DVec3(centre));
  g.patch.angle = std::acos(double(std::clamp(least, -1.0f, 1.0f)));
  // A parallelogram about its points, with the sides of its first corner.
  g.off = HUGE_VAL;
  const Vec3 P(p.x[0], p.y[0], p.z[0]), u = Vec3(p.x[kSide - 1], p.y[kSide - 1], p.z[kSide - 1]) - P;
  const Vec3 v = Vec3(p.x[kPatchPoints - kSide], p.y[kPatchPoints - kSide], p.z[kPatchPoints - kSide]) - P, n = glm::cross(u, v);
  const float n2 = glm::dot(n, n);
  if (!(n2 > 0.0f)) return true;
  const Span off = spanAlong(p, P, n), a = spanAlong(p, P, glm::cross(v, n) / n2), b = spanAlong(p, P, glm::cross(n, u) / n2);
  const double most = std::max(double(off.high), -double(off.low)) / std::sqrt(double(n2));
  if (std::isfinite(most)) g.off = most;
  const auto corner = [&](float s, float t) { return DVec3(P) + double(s) * DVec3(u) + double(t) * DVec3(v); };
  g.corner[0] = corner(a.low, b.low), g.corner[1] = corner(a.high, b.low), g.corner[2] = corner(a.low, b.high);
  return true;
}

void groupsOf(const ContourInput& in, int x0, int y0, Groups& all) {
  all.count = 1;
  if (boundWhole(in, x0, y0, all.group[0])) return;
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
  int version() const override { return 3; }  // 2: patches by surface, segments in float; 3: far sums interpolated on planes
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override { s_.hash(h); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2 + 2 * size_t(s_.hidden));
    readsContour(w, s_);
    readsHiddenContours(w, s_.extent, s_.hidden);
    return w.gives({"style_distance", Domain::ViewSample, s_.extent, {unsetPlane<float>("D")}});
  }
  size_t workingBytes() const override {
    const size_t squares = size_t(1 + s_.hidden) * 2 * (2 * sizeof(ContourSegment) + 100), picture = s_.pixel > 0.0f ? PictureSurface::bytesPerSample() : 0;
    return size_t(s_.extent.width) * size_t(s_.extent.height) * (squares + picture);
  }
  Cost cost(const TermShape& result, uint32_t) const override { return {0.0, kReceiving * 150.0 * double(result.extent.elements())}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term &visibility = *ctx.inputs.at(0), &g = *ctx.inputs.at(1);
    const auto D = ctx.result->writable<float>("D");
    const size_t count = size_t(s_.extent.width) * size_t(s_.extent.height);
    GOBO_TRY(forEachContourLayer(s_, visibility, g, [&](const ContourInput& in, size_t layer) {
      return runLayer(*ctx.arena, ctx.stop, in, &ctx, layer, D.subspan(layer * count, count), nullptr);
    }));
    return TermPtr(ctx.result);
  }

 private:
 public:
  /// `hidden`: has the inputs with hidden contours; null: there are none.
  Status runLayer(const TaskArena& arena, const StopToken& stop, const ContourInput& in, const RunContext* hidden, size_t view, std::span<float> D,
                  std::atomic<uint64_t>* terms) const {
    const float cosine = std::cos(s_.angle) - kRoundedCosine;
    GOBO_ASSIGN(std::vector<ContourSegment> contour, extractContour(in, cosine, arena, stop));
    if (hidden) GOBO_TRY(appendHiddenContours(*hidden, in, view, s_.hidden, cosine, contour));
    GOBO_ASSIGN(const ContourTree tree, ContourTree::build(contour, s_.power, double(s_.angle), (1 - kInterpolation) * kFieldError * (s_.power - 1), stop));
    const ContourTree::Pieces pieces = tree.all();
    const double reach = interpolationReach(s_.power, kInterpolation * kFieldError * (s_.power - 1));
    const double constant = straightLineConstant(s_.power);
    constexpr int kStep = kSide * kBlock;
    const int across = (in.width + kStep - 1) / kStep, down = (in.height + kStep - 1) / kStep;
    const bool complete = arena.parallelFor(
        size_t(across) * size_t(down), 1,
        [&](size_t begin, size_t end) {
          const auto scratch = std::make_unique<Scratch>();
          for (size_t k = begin; k < end; ++k) {
            const int x0 = int(k % size_t(across)) * kStep, y0 = int(k / size_t(across)) * kStep;
            for (int y = y0; y < std::min(y0 + kStep, in.height); ++y)
              std::fill_n(&D[size_t(y) * size_t(in.width) + size_t(x0)], std::min(kStep, in.width - x0), kStyleFar);
            for (int j = 0; j < kBlock; ++j)
              for (int i = 0; i < kBlock; ++i) groupsOf(in, x0 + i * kSide, y0 + j * kSide, scratch->groups[j][i]);
            runPatches({in, tree, cosine, constant, reach, D, stop, terms}, 0, 0, kBlock, pieces, nullptr, *scratch);
          }
        },
        stop);
    if (!complete || stop.stopRequested()) return Status(Code::Cancelled, "style_distance: stopped");
    return {};
  }

 private:
  struct Layer {
    const ContourInput& in;
    const ContourTree& tree;
    float cosine;
    double constant;
    double reach;  ///< of interpolation, half diagonals
    std::span<float> D;
    const StopToken& stop;
    std::atomic<uint64_t>* terms;  ///< counted, unless null
    void count(size_t more) const {
      if (terms) terms->fetch_add(more, std::memory_order_relaxed);
    }
  };
  struct Scratch {
    Groups groups[kBlock][kBlock];
    PatchSources found;
    std::vector<PatchSource> sources;
    std::vector<NearSegment> segments;
    ContourTree::Pieces rest[kBlock + 1];  ///< by the side of what they are left for
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

  /// The rectangle about side x side patches, all of them whole and on one plane; `wider`, if there is one, says which way.
  static bool flatRectangle(const Scratch& scratch, int i0, int j0, int side, double reach, const InterpolatedSum* wider, PlaneRectangle& over) {
    std::array<DVec3, 4 * kBlock * kBlock> corners;
    size_t count = 0;
    double off = 0;
    for (int j = j0; j < j0 + side; ++j)
      for (int i = i0; i < i0 + side; ++i) {
        const Groups& g = scratch.groups[j][i];
        if (g.count != 1 || g.group[0].off == HUGE_VAL) return false;
        const DVec3* c = g.group[0].corner;
        for (const DVec3& corner : {c[0], c[1], c[2], c[1] + c[2] - c[0]}) corners[count++] = corner;
        off = std::max(off, g.group[0].off);
      }
    const DVec3 first = corners[0], u = corners[size_t(4 * (side - 1)) + 1] - first, v = corners[size_t(4 * (side - 1) * side) + 2] - first;
    const DVec3 s = wider ? wider->over.s : u / glm::length(u);
    const DVec3 t = wider ? wider->over.t : v - glm::dot(v, s) * s;
    if (!(glm::length(t) > 0) || !(glm::length(s) > 0)) return false;
    over = PlaneRectangle::around(s, t / glm::length(t), std::span(corners.data(), count));
    const DVec3 n = glm::cross(over.s, over.t);
    for (size_t k = 0; k < count; ++k) off = std::max(off, std::abs(glm::dot(corners[k] - over.centre, n)));
    return off <= kOffPlane * reach * over.radius();
  }

  /// What is far from all of them is summed once, as a polynomial where they lie on one plane; the rest by quarters, down to the surfaces of one patch.
  void runPatches(const Layer& layer, int i0, int j0, int side, const ContourTree::Pieces& pieces, const InterpolatedSum* wider, Scratch& scratch) const {
    if (layer.stop.stopRequested()) return;  // a patch may see every segment of a noisy shadow
    if (side == 1) {
      const Groups& groups = scratch.groups[j0][i0];
      for (size_t k = 0; k < groups.count; ++k) {
        scratch.found.clear();
        layer.tree.gather(groups.group[k].patch, pieces, scratch.found);
        const double unit = prepare(layer, groups.group[k].patch, scratch);
        runGroup(layer, groups.group[k], groups.group[k].patch, unit, wider, scratch);
      }
      return;
    }
    const auto each = [&](const auto& body) {
      for (int j = j0; j < j0 + side; ++j)
        for (int i = i0; i < i0 + side; ++i)
          if (scratch.groups[j][i].count == 1) body(scratch.groups[j][i].group[0]);
    };
    const ContourTree::Pieces* left = &pieces;
    InterpolatedSum own;
    Patch all;
    PlaneRectangle over;
    if (around(scratch, i0, j0, side, all)) {
      ContourTree::Pieces& rest = scratch.rest[side];
      scratch.found.clear();
      if (flatRectangle(scratch, i0, j0, side, layer.reach, wider, over)) {
        all.centre = over.centre;
        all.radius = over.radius() * (1 + layer.reach * kOffPlane);
        layer.tree.gatherFar(all, pieces, layer.reach * over.radius(), scratch.found, rest);
        left = &rest;
        if (!scratch.found.sources.empty()) {
          interpolate(layer, all, over, wider, scratch, own);
          wider = &own;
        }
        if (rest.empty()) {
          if (wider) each([&](const Group& g) { runInterpolated(layer, g, *wider); });
          return;
        }
      } else if (!wider) {
        layer.tree.gatherFar(all, pieces, kFarFrom * all.radius, scratch.found, rest);
        if (rest.empty() && scratch.found.sources.size() <= kFarSources) {
          const double unit = prepare(layer, all, scratch);
          each([&](const Group& g) { runGroup(layer, g, all, unit, nullptr, scratch); });
          return;
        }
      }
    }
    const int half = side / 2;
    for (int j = j0; j < j0 + side; j += half)
      for (int i = i0; i < i0 + side; i += half) runPatches(layer, i, j, half, *left, wider, scratch);
  }

  /// The sum over the sources found, and what `wider` has, over a rectangle.
  void interpolate(const Layer& layer, const Patch& all, const PlaneRectangle& over, const InterpolatedSum* wider, Scratch& scratch,
                   InterpolatedSum& own) const {
    const double unit = prepare(layer, all, scratch);
    PatchPoints points;
    points.lanes = kPatchPoints;
    float u[kPatchPoints], v[kPatchPoints], before[kPatchPoints] = {};
    for (size_t k = 0; k < kPatchPoints; ++k) {
      const DVec3 at = InterpolatedSum::node(over, k), p = (at - all.centre) / unit;
      points.x[k] = float(p.x), points.y[k] = float(p.y), points.z[k] = float(p.z);
      points.nearest2[k] = 1;
      points.sum[k] = 0;
      if (wider) placeOn(wider->over, at, u[k], v[k]);
    }
    addSources(scratch.sources, s_.power, points);
    layer.count(kPatchPoints * (scratch.sources.size() + (wider ? 1 : 0)));
    double scale = 0;
    if (wider) interpolated(*wider, u, v, kPatchPoints, before), scale = halfPower(unit * unit / wider->unit2, s_.power);
    std::array<double, InterpolatedSum::kNodes> values;
    for (size_t k = 0; k < kPatchPoints; ++k) values[k] = double(points.sum[k]) * unit + scale * double(before[k]);
    own.over = over;
    own.unit2 = unit * unit;
    own.length = scratch.found.length + (wider ? wider->length : 0.0);
    own.fit(values);
  }
  static void placeOn(const PlaneRectangle& over, const DVec3& at, float& u, float& v) {
    const DVec3 r = at - over.centre;
    u = float(glm::dot(r, over.s) / over.halfS), v = float(glm::dot(r, over.t) / over.halfT);
  }
  /// x^(p/2).
  static double halfPower(double x, int p) {
    double result = p % 2 ? std::sqrt(x) : 1.0;
    for (int n = p / 2; n > 0; n /= 2, x *= x)
      if (n % 2) result *= x;
    return result;
  }

  /// Of sums in units of nearest2, scene units, over a contour of that length; only ratio[] is worked on in loops.
  void store(const Layer& layer, const Group& group, size_t lanes, const double* sum, const double* nearest2, const double* length) const {
    const bool local = s_.norm == StyleNorm::Local;
    float ratio[kPatchPoints], scale[kPatchPoints] = {}, d[kPatchPoints];
    for (size_t k = 0; k < lanes; ++k) {
      const double width = std::sqrt(nearest2[k]);
      scale[k] = float(width);
      ratio[k] = float(local ? sum[k] / (layer.constant * width) : sum[k] / length[k]);
    }
    powers(ratio, -1.0f / float(local ? s_.power - 1 : s_.power), lanes, d);
    for (size_t k = 0; k < group.count; ++k) {
      const double n2 = nearest2[k];
      put(layer, group.element[k], !(n2 > 0) ? 0.0f : n2 == HUGE_VAL ? kStyleFar : d[k] * scale[k]);
    }
  }

  /// All of a patch by polynomials: a unit for all of it.
  void runInterpolated(const Layer& layer, const Group& group, const InterpolatedSum& of) const {
    float u[kPatchPoints], v[kPatchPoints], ratio[kPatchPoints], d[kPatchPoints];
    const size_t lanes = lanesOf(group);
    const DVec3 s = of.over.s / of.over.halfS, t = of.over.t / of.over.halfT;
    for (size_t k = 0; k < lanes; ++k) {
      const DVec3 r = DVec3(layer.in.at(layer.in.P, group.element[std::min(k, group.count - 1)])) - of.over.centre;
      u[k] = float(glm::dot(r, s)), v[k] = float(glm::dot(r, t));
    }
    interpolated(of, u, v, lanes, ratio);
    layer.count(group.count);
    const bool local = s_.norm == StyleNorm::Local;
    const double width = std::sqrt(of.unit2);
    const float scale = float(width), share = float(1 / (local ? layer.constant * width : of.length));
    for (size_t k = 0; k < lanes; ++k) ratio[k] *= share;
    powers(ratio, -1.0f / float(local ? s_.power - 1 : s_.power), lanes, d);
    for (size_t k = 0; k < group.count; ++k) put(layer, group.element[k], d[k] * scale);
  }
  static void put(const Layer& layer, size_t e, float value) {
    value = std::clamp(std::isfinite(value) ? value : kStyleFar, kLeastStyleDistance, kStyleFar);
    layer.D[e] = layer.in.lit(e) ? value : -value;
  }
  static size_t lanesOf(const Group& group) { return (group.count + kLanes - 1) / kLanes * kLanes; }

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

  void runGroup(const Layer& layer, const Group& group, const Patch& patch, double unit, const InterpolatedSum* wider, Scratch& scratch) const {
    const ContourInput& in = layer.in;
    const bool far = !scratch.sources.empty(), near = !scratch.segments.empty();
    PatchPoints points;
    NearPoints close;
    points.lanes = close.lanes = lanesOf(group);
    float u[kPatchPoints], v[kPatchPoints], beyond[kPatchPoints];
    for (size_t k = 0; k < points.lanes; ++k) {
      const size_t e = group.element[std::min(k, group.count - 1)];
      const DVec3 p = DVec3(in.at(in.P, e)) - patch.centre, q = p / unit;
      const Vec3 n = in.at(in.N, e);
      points.x[k] = float(q.x), points.y[k] = float(q.y), points.z[k] = float(q.z);
      points.nearest2[k] = std::numeric_limits<float>::max();
      points.sum[k] = 0;
      close.x[k] = p.x, close.y[k] = p.y, close.z[k] = p.z;
      close.nx[k] = n.x, close.ny[k] = n.y, close.nz[k] = n.z;
      close.length[k] = scratch.found.length + (wider ? wider->length : 0.0);
      if (wider) placeOn(wider->over, DVec3(in.at(in.P, e)), u[k], v[k]);
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
    layer.count(group.count * (scratch.sources.size() + scratch.segments.size() + (wider ? 1 : 0)));
    double sum[kPatchPoints];
    for (size_t k = 0; k < points.lanes; ++k) sum[k] = double(points.sum[k]) * unit + close.sum[k];
    if (wider) {
      interpolated(*wider, u, v, points.lanes, beyond);
      for (size_t k = 0; k < points.lanes; ++k) {
        if (close.nearest2[k] == HUGE_VAL) close.nearest2[k] = wider->unit2;  // what was left turned out not to be seen
        sum[k] += double(beyond[k]) * halfPower(close.nearest2[k] / wider->unit2, s_.power);
      }
    }
    store(layer, group, points.lanes, sum, close.nearest2, close.length);
  }

  StyleDistanceSettings s_;
};

}  // namespace

void StyleDistanceSettings::hash(Hasher& h) const {
  h.add(power);
  h.add(int(norm));
  h.add(angle);
  if (levels > 1) h.add("level").add(level).add(levels);
  if (pixel > 0.0f) h.add("screen").add(pixel);
  if (hidden > 0) h.add("hidden").add(hidden);
}

void readsContour(Wiring& w, const StyleDistanceSettings& s) {
  w.over(0, s.extent).reads<float>(0, "V", {1, 3}).over(1, s.extent).reads<uint32_t>(1, "instance");
  if (s.pixel > 0.0f) return;
  w.reads<float>(1, "P", {3}).reads<float>(1, "N", {3}).reads<float>(1, "Ng", {3}).reads<float>(1, "footprint");
}

Status forEachContourLayer(const StyleDistanceSettings& s, const Term& visibility, const Term& gbuffer,
                           const std::function<Status(const ContourInput&, size_t)>& body) {
  std::optional<PictureSurface> picture;
  if (s.pixel > 0.0f) picture.emplace(s.extent.width, s.extent.height, s.pixel);
  for (size_t layer = 0; layer < size_t(s.extent.layers); ++layer)
    GOBO_TRY(
        body(picture ? picture->visible(visibility, gbuffer, layer, s.level, s.levels) : contourInput(visibility, gbuffer, layer, s.level, s.levels), layer));
  return {};
}

uint64_t styleDistanceTerms(const StyleDistanceSettings& settings, const Term& visibility, const Term& gbuffer, const TaskArena& arena) {
  std::atomic<uint64_t> terms = 0;
  const StyleDistanceNode node(settings);
  std::vector<float> D(size_t(settings.extent.width) * size_t(settings.extent.height));
  (void)forEachContourLayer(settings, visibility, gbuffer, [&](const ContourInput& in, size_t) { return node.runLayer(arena, {}, in, nullptr, 0, D, &terms); });
  return terms;
}

NodePtr makeStyleDistanceNode(const StyleDistanceSettings& settings) { return std::make_shared<StyleDistanceNode>(settings); }

}  // namespace filters
}  // namespace gobo

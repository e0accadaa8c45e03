// SPDX-License-Identifier: Apache-2.0
#include "filters/sheared/filter.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "filters/sheared/gather_kernels.h"

namespace gobo {
inline namespace filters {
namespace {

using sheared::Gathered;
using sheared::GatherLayer;

constexpr double kLeastTaken = 0.8;  // of the kernel
constexpr double kLeastPixels = 4;   // under a tent: with fewer of them their sum is not the integral that the density is
constexpr double kAcross = 0.5;      // bins that a pass may miss by, at its ends

class ShearedFilter final : public Node {
 public:
  explicit ShearedFilter(const ShearedFilterSettings& s) : s_(s) { GOBO_CHECK(s.radiusPx >= 0 && s.bins > 0 && s.bins <= 64); }
  std::string type() const override { return "sheared_filter"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    t.halo = (s_.passes == ShearedFilterSettings::Passes::Where ? 2 : 1) * s_.radiusPx + 1;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashLightRectangle(h, s_.light);
    h.add(s_.radiusPx).add(s_.angle).add(s_.passes).add(s_.bins);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 5);
    const Extent& view = w.input(0).extent;
    w.reads<float>(0, "V").over(1, view).reads<float>(1, "P", {3}).reads<float>(1, "N", {3}).reads<float>(1, "footprint").reads<uint32_t>(1, "instance");
    w.over(2, view)
        .reads<float>(2, "point", {w.channels(2, "point")})
        .require(w.channels(2, "point") > 0 && w.channels(2, "point") % 16 == 0, "input 2 has no samples");
    w.over(3, view).reads<float>(3, "shear").reads<float>(3, "width").over(4, view).reads<uint32_t>(4, "n");
    return w.gives({"visibility", Domain::ViewSample, view, {plane<float>("V")}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override;

 private:
  ShearedFilterSettings s_;
};

/// One layer's geometry relative to the light.
struct Geometry {
  std::vector<float> x, y, height, px, py, pz, nx, ny, nz;
  explicit Geometry(size_t n) {
    for (auto* v : {&x, &y, &height, &px, &py, &pz, &nx, &ny, &nz}) v->assign(n, 0.0f);
  }
  void set(size_t i, const Vec3& r, const Vec3& n, const LightRectangle& light) {
    const float h = glm::dot(r, light.axis), far = std::copysign(std::max({std::fabs(h), 1.0e-6f * glm::length(r), 1.0e-30f}), h);
    x[i] = glm::dot(r, light.u) / far;
    y[i] = glm::dot(r, light.v) / far;
    height[i] = far;
    px[i] = r.x;
    py[i] = r.y;
    pz[i] = r.z;
    nx[i] = n.x;
    ny[i] = n.y;
    nz[i] = n.z;
  }
};

/// What a step to the next pixel is, metres in the light's plane along u and v, from the neighbours on the same instance; 0 where there are none.
struct Steps {
  float rowU = 0, rowV = 0, columnU = 0, columnV = 0;
};
Steps stepsOf(const GatherLayer& L, int x, int y) {
  const size_t p = size_t(y) * size_t(L.columns) + size_t(x);
  Steps s;
  auto between = [&](size_t a, size_t b, float& u, float& v) {
    if (L.instance[a] != L.instance[p] || L.instance[b] != L.instance[p] || a == b) return;
    const float share = a == p || b == p ? 1.0f : 0.5f;
    u = share * (L.x[b] - L.x[a]) * L.height[p];
    v = share * (L.y[b] - L.y[a]) * L.height[p];
  };
  const size_t w = size_t(L.columns);
  between(x > 0 ? p - 1 : p, x + 1 < L.columns ? p + 1 : p, s.rowU, s.rowV);
  between(y > 0 ? p - w : p, y + 1 < L.rows ? p + w : p, s.columnU, s.columnV);
  return s;
}

Result<TermPtr> ShearedFilter::run(const RunContext& ctx) const {
  const Extent e = ctx.inputs[0]->extent();
  const auto V = ctx.inputs[0]->floats("V"), P = ctx.inputs[1]->floats("P"), N = ctx.inputs[1]->floats("N"), points = ctx.inputs[2]->floats("point");
  const auto shear = ctx.inputs[3]->floats("shear"), width = ctx.inputs[3]->floats("width");
  const auto instance = ctx.inputs[1]->plane<uint32_t>("instance"), n = ctx.inputs[4]->plane<uint32_t>("n");
  for (float v : V)
    if (!std::isfinite(v)) return internalError("sheared_filter: visibility is not finite");
  const auto out = ctx.result->writable<float>("V");
  std::copy(V.begin(), V.end(), out.begin());
  const Status stopped(Code::Cancelled, "sheared_filter: stopped");
  const size_t square = size_t(e.width) * size_t(e.height), kept = size_t(ctx.inputs[2]->channels("point")) / 4, bins = size_t(s_.bins);
  for (int layer = 0; layer < e.layers; ++layer) {
    const size_t base = size_t(layer) * square;
    Geometry g(square);
    bool complete = ctx.arena->parallelFor(
        square, 1 << 12,
        [&](size_t from, size_t to) {
          for (size_t i = from; i < to; ++i) {
            const size_t k = 3 * (base + i);
            if (instance[base + i] != ~0u) g.set(i, Vec3(P[k], P[k + 1], P[k + 2]) - s_.light.centre, Vec3(N[k], N[k + 1], N[k + 2]), s_.light);
          }
        },
        ctx.stop);
    if (!complete) return stopped;
    std::vector<float> areas(square);
    GatherLayer L{g.x.data(),
                  g.y.data(),
                  g.height.data(),
                  g.px.data(),
                  g.py.data(),
                  g.pz.data(),
                  g.nx.data(),
                  g.ny.data(),
                  g.nz.data(),
                  &shear[base],
                  &width[base],
                  areas.data(),
                  &instance[base],
                  &n[base],
                  &points[4 * kept * base],
                  kept,
                  e.width,
                  e.height,
                  s_.light.halfU,
                  s_.light.halfV,
                  std::cos(s_.angle) - 1.0e-6f};
    std::vector<int> rx(square), ry(square);
    std::vector<double> whole(square);
    std::vector<uint8_t> passes(square);
    complete = ctx.arena->parallelFor(
        size_t(e.height), 8,
        [&](size_t y0, size_t y1) {
          for (size_t y = y0; y < y1; ++y)
            for (int x = 0; x < e.width; ++x) {
              const size_t i = y * size_t(e.width) + size_t(x);
              if (L.instance[i] == ~0u) continue;
              const Steps s = stepsOf(L, x, int(y));
              const double area = std::fabs(double(s.rowU) * double(s.columnV) - double(s.rowV) * double(s.columnU));
              if (!(area > 0) || !std::isfinite(float(area))) continue;
              areas[i] = float(area);
              if (!(L.shear[i] > 0.0f) || !(L.width[i] > 0.0f)) continue;
              const double tents = double(L.width[i]) * double(L.width[i]);
              if (!(tents >= kLeastPixels * area)) continue;
              // The tents' integral, and how far along an image axis their corner lies.
              whole[i] = tents;
              auto reach = [&](float u, float v) {
                const double r = std::ceil(double(L.width[i]) * (std::fabs(double(u)) + std::fabs(double(v))) / area);
                return r < double(s_.radiusPx) ? int(r) : s_.radiusPx;
              };
              rx[i] = reach(s.columnU, s.columnV);
              ry[i] = reach(s.rowU, s.rowV);
              const double across =
                  double(L.shear[i]) * std::max(rx[i] * std::fabs(double(s.rowV)) / double(L.halfV), ry[i] * std::fabs(double(s.columnU)) / double(L.halfU));
              passes[i] = s_.passes == ShearedFilterSettings::Passes::Where && across <= kAcross * 2.0 / double(bins);
            }
        },
        ctx.stop);
    if (!complete) return stopped;
    const bool any = std::any_of(passes.begin(), passes.end(), [](uint8_t b) { return b != 0; });
    std::vector<float> sums(any ? 2 * bins * square : 0), taken(any ? square : 0);
    if (any) {
      complete = ctx.arena->parallelFor(
          size_t(e.height), 4,
          [&](size_t y0, size_t y1) {
            for (size_t y = y0; y < y1; ++y)
              for (int x = 0; x < e.width; ++x) {
                const size_t i = y * size_t(e.width) + size_t(x);
                if (rx[i] > 0) taken[i] = sheared::gatherRow(L, x, int(y), rx[i], s_.bins, &sums[2 * bins * i]);
              }
          },
          ctx.stop);
      if (!complete) return stopped;
    }
    complete = ctx.arena->parallelFor(
        size_t(e.height), 2,
        [&](size_t y0, size_t y1) {
          for (size_t y = y0; y < y1; ++y)
            for (int x = 0; x < e.width; ++x) {
              const size_t i = y * size_t(e.width) + size_t(x);
              if (!(whole[i] > 0)) continue;
              const Gathered sum =
                  passes[i] ? sheared::gatherColumn(L, x, int(y), ry[i], s_.bins, sums.data(), taken.data()) : sheared::gather(L, x, int(y), rx[i], ry[i]);
              if (!(sum.taken >= kLeastTaken * whole[i]) || !(sum.weight > 0)) continue;
              out[base + i] = clamp01(float(sum.seen / sum.weight));
            }
        },
        ctx.stop);
    if (!complete) return stopped;
  }
  return TermPtr(ctx.result);
}

}  // namespace

NodePtr makeShearedFilter(const ShearedFilterSettings& settings) { return std::make_shared<ShearedFilter>(settings); }

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "filters/axis_aligned/filter.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "filters/axis_aligned/taps_kernels.h"
#include "formulas/axis_aligned.glsl.h"

namespace gobo {
inline namespace filters {
namespace {

using axis_aligned::kLanes;
using axis_aligned::kReject;
using axis_aligned::TapBlock;
using axis_aligned::TapLayer;

constexpr int kPad = kAxisAlignedMaxRadius + kLanes;  // columns of rejected pixels either side: no bounds checks in a row

/// One layer's data, structure of arrays, rows padded by kPad. Positions are relative to the light, so that a scene far from the
/// origin keeps its digits.
struct Layer {
  int width, height, stride;
  bool planar;
  std::vector<float> px, py, pz, nx, ny, nz, ax, ay, az, beta, omega, value, result;  // omega: of literal thresholds alone

  Layer(int w, int h, bool onePlane, bool withOmega) : width(w), height(h), stride((w + kLanes - 1) / kLanes * kLanes + 2 * kPad), planar(onePlane) {
    const size_t n = size_t(stride) * h;
    for (auto* v : {&px, &py, &pz, &nx, &ny, &nz, &value, &result}) v->assign(n, 0.0f);
    for (auto* v : {&ax, &ay, &az}) v->assign(n, 0.0f);
    beta.assign(n, kReject);
    if (withOmega) omega.assign(n, kReject);
  }
  size_t at(int x, int y) const { return size_t(y) * stride + kPad + x; }
  Vec3 position(size_t i) const { return Vec3(px[i], py[i], pz[i]); }
  /// Distance of two pixels in the light's plane, for the first of them.
  float distance(size_t i, size_t j) const {
    if (planar) return std::sqrt(((ax[j] - ax[i]) * (ax[j] - ax[i]) + (ay[j] - ay[i]) * (ay[j] - ay[i])) * az[i]);
    const Vec3 axis(ax[i], ay[i], az[i]), d = position(j) - position(i);
    return glm::length(d - glm::dot(d, axis) * axis);
  }
  TapLayer taps(const AxisAlignedFilterSettings& s) const {
    TapLayer t{px.data(), py.data(), pz.data(), nx.data(), ny.data(), nz.data(), ax.data(), ay.data(), az.data(), beta.data(), value.data()};
    t.betaThreshold = s.betaThreshold;
    t.cosAngle = std::cos(s.angle) - 1.0e-6f;  // the slack keeps parallel normals parallel at angle 0
    t.literal = s.literal();
    t.compared = beta.data();
    if (s.cut > 0) t.cutBetas2 = s.cut * s.cut;
    if (s.thresholds == AxisAlignedThresholds::Report) t.cosAngle = -2.0f, t.reachBetas2 = 0.0f, t.reach2 = 3.0e38f;
    if (s.thresholds == AxisAlignedThresholds::Code) {
      t.compared = omega.data();
      t.betaThreshold = 0.0f;
      t.absolute = kCodeOmegaThreshold;
      t.reachBetas2 = 0.0f;
      t.reach2 = kCodeReach2;
    }
    return t;
  }
};

/// Two unit vectors that span the plane with that normal; those of -n are the same but for signs.
void planeAxes(const Vec3& n, Vec3& u, Vec3& v) {
  const Vec3 a = glm::abs(n);
  const Vec3 least = a.x <= a.y && a.x <= a.z ? Vec3(1, 0, 0) : a.y <= a.z ? Vec3(0, 1, 0) : Vec3(0, 0, 1);
  u = glm::normalize(glm::cross(n, least));
  v = glm::cross(n, u);
}

class AxisAlignedFilter final : public Node {
 public:
  explicit AxisAlignedFilter(const AxisAlignedFilterSettings& s) : s_(s) {
    GOBO_CHECK(s.radiusPx >= 0 && s.radiusPx <= kAxisAlignedMaxRadius);
    GOBO_CHECK_GT(s.k, 0.0f);
  }
  std::string type() const override { return "axis_aligned_filter"; }
  int version() const override { return 2; }  // 2: pixels move along their line to the light
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    t.linearPerGroup = t.rangePreserving = !s_.fourthOrder;  // the fourth order overshoots and is limited to what visibility can be
    t.halo = s_.radiusPx + 1;                                // + 1: the pixel step is measured to both neighbours
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashShadowLightFrame(h, s_.light);
    h.add(s_.k).add(s_.radiusPx).add(s_.betaThreshold).add(s_.angle).add(s_.fourthOrder).add(s_.exact2d);
    if (s_.literal()) h.add("literal").add(int(s_.distance)).add(int(s_.thresholds)).add(s_.cut);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 3);
    const Extent& view = w.input(0).extent;
    w.reads<float>(0, "V", {1, 3})
        .over(1, view)
        .reads<float>(1, "P", {3})
        .reads<float>(1, "N", {3})
        .reads<float>(1, "footprint")
        .reads<uint32_t>(1, "instance");
    w.over(2, view).reads<float>(2, "Omega");
    return w.gives({"visibility", Domain::ViewSample, view, {plane<float>("V", std::max(w.channels(0, "V"), 1))}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override;
  const AxisAlignedFilterSettings& settings() const { return s_; }

 private:
  bool fill(Layer& L, const RunContext& ctx, int layer, size_t channel, size_t channels) const;
  void radii(const Layer& L, std::span<const uint32_t> instance, std::span<const float> footprint, size_t base, int y, bool columns,
             std::vector<int>& out) const;
  bool pass(Layer& L, const std::vector<int>& rx, const std::vector<int>& ry, const RunContext& ctx) const;
  AxisAlignedFilterSettings s_;
};

/// Copies layer `layer` of the inputs, one channel of V. False if stopped.
bool AxisAlignedFilter::fill(Layer& L, const RunContext& ctx, int layer, size_t channel, size_t channels) const {
  const auto value = ctx.inputs[0]->floats("V"), P = ctx.inputs[1]->floats("P"), N = ctx.inputs[1]->floats("N"), omega = ctx.inputs[2]->floats("Omega");
  const auto instance = ctx.inputs[1]->plane<uint32_t>("instance");
  const size_t base = size_t(layer) * L.width * L.height;
  Vec3 u(0.0f), v(0.0f);
  const bool world = s_.distance == AxisAlignedDistance::World;
  if (L.planar) planeAxes(s_.light.axis, u, v);
  return ctx.arena->parallelFor(
      L.height, 16,
      [&](size_t y0, size_t y1) {
        for (size_t y = y0; y < y1; ++y)
          for (int x = 0; x < L.width; ++x) {
            const size_t e = base + y * L.width + x, i = L.at(x, int(y));
            L.value[i] = value[channels * e + channel];
            if (instance[e] == ~0u || !(omega[e] > 0.0f)) continue;
            const Vec3 r = Vec3(P[3 * e], P[3 * e + 1], P[3 * e + 2]) - (s_.light.distant ? Vec3(0.0f) : s_.light.centre);
            const Vec3 a = world ? Vec3(0.0f) : s_.light.normalFor(r);
            L.px[i] = r.x;
            L.py[i] = r.y;
            L.pz[i] = r.z;
            L.nx[i] = N[3 * e];
            L.ny[i] = N[3 * e + 1];
            L.nz[i] = N[3 * e + 2];
            if (L.planar && s_.light.distant) {  // parallel lines: the place on the plane is the same from any distance
              L.ax[i] = float(glm::dot(DVec3(r), DVec3(u)));
              L.ay[i] = float(glm::dot(DVec3(r), DVec3(v)));
              L.az[i] = 1.0f;
            } else if (L.planar) {
              const float h = glm::dot(r, a), far = std::max(std::fabs(h), 1.0e-6f * glm::length(r));  // the plane itself is seen edge on
              L.ax[i] = glm::dot(r, u) / std::copysign(std::max(far, 1.0e-30f), h);
              L.ay[i] = glm::dot(r, v) / std::copysign(std::max(far, 1.0e-30f), h);
              L.az[i] = far * far;
            } else {
              L.ax[i] = a.x;
              L.ay[i] = a.y;
              L.az[i] = a.z;
            }
            L.beta[i] = formulas::aaBeta(omega[e], s_.k);
            if (!L.omega.empty()) L.omega[i] = omega[e];
          }
      },
      ctx.stop);
}

/// Filter radius in pixels along rows or columns: 3 beta over the pixel step in the light plane, measured to the neighbours on the same
/// instance (both, or the one there is; the pixel's footprint where there is none or the step vanishes). 0 where nothing is filtered.
void AxisAlignedFilter::radii(const Layer& L, std::span<const uint32_t> instance, std::span<const float> footprint, size_t base, int y, bool columns,
                              std::vector<int>& out) const {
  for (int x = 0; x < L.width; ++x) {
    const size_t i = L.at(x, y), e = base + size_t(y) * L.width + x;
    if (L.beta[i] == kReject) {
      out[i] = 0;
      continue;
    }
    float length = 0.0f;
    int steps = 0;
    for (int side = 0; side < 2; ++side) {
      const int qx = columns ? x : x + (side ? 1 : -1), qy = columns ? y + (side ? 1 : -1) : y;
      if (qx < 0 || qy < 0 || qx >= L.width || qy >= L.height) continue;
      const size_t q = L.at(qx, qy);
      if (L.beta[q] == kReject || instance[base + size_t(qy) * L.width + qx] != instance[e]) continue;
      length += L.distance(i, q);
      ++steps;
    }
    length = steps > 0 ? length / float(steps) : 0.0f;
    if (!(length > 1.0e-6f * footprint[e])) length = footprint[e];
    const float r = std::ceil(3.0f * L.beta[i] / std::max(length, 1.0e-30f));
    out[i] = r < float(s_.radiusPx) ? int(r) : s_.radiusPx;
  }
}

/// value -> result: one gather over the box rx x ry around each pixel (a row or a column when the other is all zero).
bool AxisAlignedFilter::pass(Layer& L, const std::vector<int>& rx, const std::vector<int>& ry, const RunContext& ctx) const {
  const TapLayer taps = L.taps(s_);
  return ctx.arena->parallelFor(
      L.height, 2,
      [&](size_t y0, size_t y1) {
        TapBlock block;
        for (int y = int(y0); y < int(y1); ++y)
          for (int x = 0; x < L.width; x += kLanes) {
            const size_t p = L.at(x, y);
            int maxX = 0, maxY = 0;
            bool any = false;
            for (int l = 0; l < kLanes; ++l) {
              maxX = std::max(maxX, rx[p + l]);
              maxY = std::max(maxY, ry[p + l]);
              any |= L.beta[p + l] != kReject;
              L.result[p + l] = L.value[p + l];
            }
            if (!any || maxX + maxY == 0) continue;
            block.load(taps, p);
            for (int j = std::max(-maxY, -y); j <= std::min(maxY, L.height - 1 - y); ++j) {
              int reach[kLanes];
              for (int l = 0; l < kLanes; ++l) reach[l] = std::abs(j) <= ry[p + l] ? rx[p + l] : -1;
              block.add(taps, p, long(j) * L.stride, -maxX, maxX, reach, L.planar, s_.fourthOrder);
            }
            for (int l = 0; l < kLanes; ++l) L.result[p + l] = block.result(l, s_.fourthOrder);
          }
      },
      ctx.stop);
}

Result<TermPtr> AxisAlignedFilter::run(const RunContext& ctx) const {
  const Extent extent = ctx.inputs[0]->extent();
  const auto instance = ctx.inputs[1]->plane<uint32_t>("instance");
  const auto footprint = ctx.inputs[1]->floats("footprint"), value = ctx.inputs[0]->floats("V");
  for (float v : value)
    if (!std::isfinite(v)) return internalError("axis_aligned_filter: visibility is not finite");
  const auto& term = ctx.result;
  const size_t C = size_t(ctx.inputs[0]->channels("V"));  // RGB where light passes tinted panes: the same kernel for each
  const auto out = term->writable<float>("V");
  const Status stopped(Code::Cancelled, "axis_aligned_filter: stopped");
  for (int layer = 0; layer < extent.layers; ++layer) {
    const size_t base = size_t(layer) * extent.width * extent.height;
    const size_t square = size_t(extent.width) * extent.height;
    if (s_.radiusPx == 0) {
      std::copy_n(value.begin() + C * base, C * square, out.begin() + C * base);
      continue;
    }
    Layer L(extent.width, extent.height, !s_.light.facing && s_.distance == AxisAlignedDistance::Line, s_.thresholds == AxisAlignedThresholds::Code);
    std::vector<int> rx(L.value.size()), ry(L.value.size()), none(L.value.size());
    for (size_t c = 0; c < C; ++c) {
      if (!fill(L, ctx, layer, c, C)) return stopped;
      const bool measured = c > 0 || ctx.arena->parallelFor(
                                         L.height, 16,
                                         [&](size_t y0, size_t y1) {
                                           for (size_t y = y0; y < y1; ++y) {
                                             radii(L, instance, footprint, base, int(y), false, rx);
                                             radii(L, instance, footprint, base, int(y), true, ry);
                                           }
                                         },
                                         ctx.stop);
      if (!measured) return stopped;
      if (s_.exact2d) {
        if (!pass(L, rx, ry, ctx)) return stopped;
      } else {
        if (!pass(L, rx, none, ctx)) return stopped;
        L.value.swap(L.result);
        if (!pass(L, none, ry, ctx)) return stopped;
      }
      for (int y = 0; y < L.height; ++y)
        for (int x = 0; x < L.width; ++x) out[C * (base + size_t(y) * L.width + x) + c] = s_.fourthOrder ? clamp01(L.result[L.at(x, y)]) : L.result[L.at(x, y)];
    }
  }
  return TermPtr(term);
}

}  // namespace

const AxisAlignedFilterSettings& settingsOfAxisAlignedFilter(const Node& node) {
  const auto* filter = dynamic_cast<const AxisAlignedFilter*>(&node);
  GOBO_CHECK(filter != nullptr);
  return filter->settings();
}
NodePtr makeAxisAlignedFilter(const AxisAlignedFilterSettings& settings) { return std::make_shared<AxisAlignedFilter>(settings); }

}  // namespace filters
}  // namespace gobo

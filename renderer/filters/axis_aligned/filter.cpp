// SPDX-License-Identifier: Apache-2.0
#include "filters/axis_aligned/filter.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "formulas/axis_aligned.glsl.h"

namespace gobo {
namespace {

constexpr int kLanes = 8;
constexpr int kPad = kAxisAlignedMaxRadius + kLanes;  // columns of rejected pixels either side: no bounds checks in a row
constexpr float kReject = -1.0e30f;                   // a beta that differs from every other by more than any threshold

/// One layer's data, structure of arrays, rows padded by kPad. Positions are relative to the light, so that a scene far from the
/// origin keeps its digits.
struct Layer {
  int width, height, stride;
  std::vector<float> px, py, pz, nx, ny, nz, ax, ay, az, beta, value, result;

  Layer(int w, int h) : width(w), height(h), stride((w + kLanes - 1) / kLanes * kLanes + 2 * kPad) {
    for (auto* v : {&px, &py, &pz, &nx, &ny, &nz, &ax, &ay, &az, &value, &result}) v->assign(size_t(stride) * h, 0.0f);
    beta.assign(size_t(stride) * h, kReject);
  }
  size_t at(int x, int y) const { return size_t(y) * stride + kPad + x; }
  Vec3 position(size_t i) const { return Vec3(px[i], py[i], pz[i]); }
};

struct Limits {
  float betaThreshold, cosAngle;
};

/// Eight neighbouring pixels of a row and their running sums. A lane whose own radius is smaller than the offset takes weight 0, so
/// a pixel's sum does not depend on its neighbours in the block (tiles agree bit for bit).
struct Block {
  float v[kLanes], x[kLanes], y[kLanes], z[kLanes], nx[kLanes], ny[kLanes], nz[kLanes], ax[kLanes], ay[kLanes], az[kLanes];
  float beta[kLanes], inverse[kLanes], reach2[kLanes], sum[kLanes], weight[kLanes];

  void load(const Layer& L, size_t first) {
    for (int l = 0; l < kLanes; ++l) {
      const size_t p = first + l;
      v[l] = L.value[p];
      x[l] = L.px[p];
      y[l] = L.py[p];
      z[l] = L.pz[p];
      nx[l] = L.nx[p];
      ny[l] = L.ny[p];
      nz[l] = L.nz[p];
      ax[l] = L.ax[p];
      ay[l] = L.ay[p];
      az[l] = L.az[p];
      beta[l] = L.beta[p];
      const float b = std::max(beta[l], 1.0e-18f);
      inverse[l] = 0.5f / (b * b);
      reach2[l] = 36.0f * b * b;
      sum[l] = 0.0f;
      weight[l] = 1.0f;  // the centre tap
    }
  }

  /// Adds the pixels `q`..q+7, each to its lane, where |offset| <= radius[lane]. The sums are of differences to the centre, so a constant
  /// stays itself to the bit and a result stays within the range of its taps.
  void tap(const Layer& L, size_t q, int offset, const int* radius, const Limits& limits) {
    const float *lx = &L.px[q], *ly = &L.py[q], *lz = &L.pz[q], *lnx = &L.nx[q], *lny = &L.ny[q], *lnz = &L.nz[q];
    const float *lb = &L.beta[q], *lv = &L.value[q];
    float kept[kLanes], difference[kLanes];  // locals alias nothing: the loop vectorises without run-time checks
    for (int l = 0; l < kLanes; ++l) {
      const float dx = lx[l] - x[l], dy = ly[l] - y[l], dz = lz[l] - z[l];
      const float along = dx * ax[l] + dy * ay[l] + dz * az[l];
      const float d2 = dx * dx + dy * dy + dz * dz;
      const float w = formulas::aaWeight(formulas::maxOf(d2 - along * along, 0.0f), inverse[l]);
      const float cosine = lnx[l] * nx[l] + lny[l] * ny[l] + lnz[l] * nz[l];
      const float apart = std::fabs(lb[l] - beta[l]) - limits.betaThreshold * formulas::maxOf(lb[l], beta[l]);
      float k = d2 <= reach2[l] ? w : 0.0f;
      k = cosine >= limits.cosAngle ? k : 0.0f;
      k = apart <= 0.0f ? k : 0.0f;
      kept[l] = offset <= radius[l] ? k : 0.0f;
      difference[l] = lv[l] - v[l];
    }
    for (int l = 0; l < kLanes; ++l) {
      sum[l] += kept[l] * difference[l];
      weight[l] += kept[l];
    }
  }
};

class AxisAlignedFilter final : public Node {
 public:
  explicit AxisAlignedFilter(const AxisAlignedFilterSettings& s) : s_(s) {
    GOBO_CHECK(s.radiusPx >= 0 && s.radiusPx <= kAxisAlignedMaxRadius);
    GOBO_CHECK_GT(s.k, 0.0f);
  }
  std::string type() const override { return "axis_aligned_filter"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.linearPerGroup = t.rangePreserving = t.tileable = true;
    t.halo = s_.radiusPx + 1;  // + 1: the pixel step is measured to both neighbours
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashShadowLightFrame(h, s_.light);
    h.add(s_.k).add(s_.radiusPx).add(s_.betaThreshold).add(s_.angle).add(s_.exact2d);
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
  return ctx.arena->parallelFor(
      L.height, 16,
      [&](size_t y0, size_t y1) {
        for (size_t y = y0; y < y1; ++y)
          for (int x = 0; x < L.width; ++x) {
            const size_t e = base + y * L.width + x, i = L.at(x, int(y));
            L.value[i] = value[channels * e + channel];
            if (instance[e] == ~0u || !(omega[e] > 0.0f)) continue;
            const Vec3 r = Vec3(P[3 * e], P[3 * e + 1], P[3 * e + 2]) - s_.light.centre, a = s_.light.normalFor(r);
            L.px[i] = r.x;
            L.py[i] = r.y;
            L.pz[i] = r.z;
            L.nx[i] = N[3 * e];
            L.ny[i] = N[3 * e + 1];
            L.nz[i] = N[3 * e + 2];
            L.ax[i] = a.x;
            L.ay[i] = a.y;
            L.az[i] = a.z;
            L.beta[i] = formulas::aaBeta(omega[e], s_.k);
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
    const Vec3 axis(L.ax[i], L.ay[i], L.az[i]);
    Vec3 ends[2] = {L.position(i), L.position(i)};
    int steps = 0;
    for (int side = 0; side < 2; ++side) {
      const int qx = columns ? x : x + (side ? 1 : -1), qy = columns ? y + (side ? 1 : -1) : y;
      if (qx < 0 || qy < 0 || qx >= L.width || qy >= L.height) continue;
      const size_t q = L.at(qx, qy);
      if (L.beta[q] == kReject || instance[base + size_t(qy) * L.width + qx] != instance[e]) continue;
      ends[side] = L.position(q);
      ++steps;
    }
    const Vec3 step = ends[1] - ends[0];
    float length = steps > 0 ? glm::length(step - glm::dot(step, axis) * axis) / float(steps) : 0.0f;
    if (!(length > 1.0e-6f * footprint[e])) length = footprint[e];
    const float r = std::ceil(3.0f * L.beta[i] / std::max(length, 1.0e-30f));
    out[i] = r < float(s_.radiusPx) ? int(r) : s_.radiusPx;
  }
}

/// value -> result: one gather over the box rx x ry around each pixel (a row or a column when the other is all zero).
bool AxisAlignedFilter::pass(Layer& L, const std::vector<int>& rx, const std::vector<int>& ry, const RunContext& ctx) const {
  const Limits limits{s_.betaThreshold, std::cos(s_.angle) - 1.0e-6f};  // the slack keeps parallel normals parallel at angle 0
  return ctx.arena->parallelFor(
      L.height, 2,
      [&](size_t y0, size_t y1) {
        Block block;
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
            block.load(L, p);
            for (int j = std::max(-maxY, -y); j <= std::min(maxY, L.height - 1 - y); ++j) {
              int reach[kLanes];
              for (int l = 0; l < kLanes; ++l) reach[l] = std::abs(j) <= ry[p + l] ? rx[p + l] : -1;
              for (int i = -maxX; i <= maxX; ++i)
                if (i != 0 || j != 0) block.tap(L, size_t(int64_t(p) + int64_t(j) * L.stride + i), std::abs(i), reach, limits);
            }
            for (int l = 0; l < kLanes; ++l) L.result[p + l] = block.v[l] + block.sum[l] / block.weight[l];
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
    Layer L(extent.width, extent.height);
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
        for (int x = 0; x < L.width; ++x) out[C * (base + size_t(y) * L.width + x) + c] = L.result[L.at(x, y)];
    }
  }
  return TermPtr(term);
}

}  // namespace

NodePtr makeAxisAlignedFilter(const AxisAlignedFilterSettings& settings) { return std::make_shared<AxisAlignedFilter>(settings); }

}  // namespace gobo

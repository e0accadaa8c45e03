// SPDX-License-Identifier: Apache-2.0
#include "filters/axis_aligned/predicted_width.h"

#include <algorithm>
#include <cmath>

#include "filters/axis_aligned/window_kernels.h"
#include "formulas/axis_aligned.glsl.h"

namespace gobo {
inline namespace filters {
namespace {

constexpr float kWidestPenumbra = 1.0e9f;  // pixels; its fourth power is still a float

class ShadowPenumbra final : public Node {
 public:
  ShadowPenumbra(int radius, float sigma, const Extent& extent) : radius_(radius), sigma_(sigma), extent_(extent) {}
  std::string type() const override { return "shadow_penumbra"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    t.halo = radius_;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(radius_).add(sigma_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    w.over(0, extent_).reads<float>(0, "sMin").reads<float>(0, "sumV", {1, 3}).reads<float>(0, "sumW").reads<uint8_t>(0, "occluded");
    w.over(1, extent_).reads<float>(1, "footprint").reads<uint32_t>(1, "instance");
    return w.gives({type(), Domain::ViewSample, extent_, {plane<float>("size"), plane<uint8_t>("seen")}});
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& slopes = *ctx.inputs.at(0);
    const auto sMin = slopes.floats("sMin"), sumV = slopes.floats("sumV"), sumW = slopes.floats("sumW"), footprint = ctx.inputs.at(1)->floats("footprint");
    const auto occluded = slopes.plane<uint8_t>("occluded");
    const auto instance = ctx.inputs[1]->plane<uint32_t>("instance");
    const size_t C = size_t(slopes.channels("sumV"));
    const Extent e = extent_;
    const auto size = ctx.result->writable<float>("size");
    const auto seen = ctx.result->writable<uint8_t>("seen");
    const size_t rows = size_t(e.height) * e.layers;
    // Of each view sample: S^-4 and 1 if it met an occluder; what it met (1 an occluder, 2 the light). Then sums along rows, then along columns.
    std::vector<float> narrow(e.elements()), one(e.elements()), rowNarrow(e.elements()), rowOne(e.elements());
    std::vector<uint8_t> met(e.elements()), rowMet(e.elements());
    bool complete = ctx.arena->parallelFor(
        e.elements(), 1 << 13,
        [&](size_t from, size_t to) {
          for (size_t p = from; p < to; ++p) {
            if (instance[p] == ~0u) continue;
            for (size_t c = 0; c < C; ++c)
              if (sumV[C * p + c] > 0.0f) met[p] |= 2;
            if (!occluded[p]) continue;
            met[p] |= 1;
            const float wide = std::max(sigma_ * sMin[p] / footprint[p], kNarrowestPenumbra);
            if (!std::isfinite(wide)) continue;  // a vanishing footprint
            const float s = std::min(wide, kWidestPenumbra), s2 = s * s;
            narrow[p] = 1.0f / (s2 * s2);
            one[p] = 1.0f;
          }
        },
        ctx.stop);
    complete = complete && ctx.arena->parallelFor(
                               rows, 8,
                               [&](size_t y0, size_t y1) {
                                 for (size_t y = y0; y < y1; ++y) {
                                   const size_t row = y * size_t(e.width);
                                   for (int i = -std::min(radius_, e.width - 1); i <= std::min(radius_, e.width - 1); ++i) {
                                     const size_t p = row + size_t(std::max(0, -i)), q = row + size_t(std::max(0, i));
                                     axis_aligned::addToWindow(size_t(e.width - std::abs(i)), &instance[p], &instance[q], &narrow[q], &one[q], &met[q],
                                                               &rowNarrow[p], &rowOne[p], &rowMet[p]);
                                   }
                                 }
                               },
                               ctx.stop);
    complete = complete &&
               ctx.arena->parallelFor(
                   rows, 8,
                   [&](size_t y0, size_t y1) {
                     std::vector<float> sum, count;
                     for (size_t y = y0; y < y1; ++y) {
                       const size_t row = y * size_t(e.width), first = y - y % size_t(e.height);
                       sum.assign(size_t(e.width), 0.0f);
                       count.assign(size_t(e.width), 0.0f);
                       for (size_t r = std::max(first, y - std::min(y, size_t(radius_))); r <= std::min(first + size_t(e.height) - 1, y + size_t(radius_)); ++r)
                         axis_aligned::addToWindow(size_t(e.width), &instance[row], &instance[r * size_t(e.width)], &rowNarrow[r * size_t(e.width)],
                                                   &rowOne[r * size_t(e.width)], &rowMet[r * size_t(e.width)], sum.data(), count.data(), &seen[row]);
                       for (size_t x = 0; x < size_t(e.width); ++x) {
                         const size_t p = row + x;
                         const bool surface = instance[p] != ~0u, lit = surface && sumW[p] > 0.0f;
                         // A light that barely rises over a surface may show itself to more points than the pilot's; where it does not, they cost no ray.
                         seen[p] = surface && (seen[p] == 3 || !lit);
                         size[p] = lit && count[x] > 0.0f ? 1.0f / std::sqrt(std::sqrt(sum[x] / count[x])) : 0.0f;
                       }
                     }
                   },
                   ctx.stop);
    if (!complete) return Status(Code::Cancelled, "shadow_penumbra: stopped");
    return TermPtr(ctx.result);
  }

 private:
  int radius_;
  float sigma_;
  Extent extent_;
};

class ShadowPenumbraCount final : public Node {
 public:
  ShadowPenumbraCount(uint32_t pilot, uint32_t samples, const Extent& extent) : pilot_(pilot), samples_(std::max(pilot, samples)), extent_(extent) {}
  std::string type() const override { return "shadow_penumbra_count"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(pilot_).add(samples_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    w.over(0, extent_).reads<uint8_t>(0, "seen");
    return w.gives({type(), Domain::ViewSample, extent_, {plane<uint32_t>("n")}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto seen = ctx.inputs.at(0)->plane<uint8_t>("seen");
    const auto n = ctx.result->writable<uint32_t>("n");
    const bool complete = ctx.arena->parallelFor(
        seen.size(), 1 << 13,
        [&](size_t from, size_t to) {
          for (size_t p = from; p < to; ++p) n[p] = seen[p] ? samples_ : pilot_;
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "shadow_penumbra_count: stopped");
    return TermPtr(ctx.result);
  }

 private:
  uint32_t pilot_, samples_;
  Extent extent_;
};

class ShadowPredictedWidth final : public Node {
 public:
  ShadowPredictedWidth(bool fourthOrder, const Extent& extent) : fourthOrder_(fourthOrder), extent_(extent) {}
  std::string type() const override { return "shadow_predicted_width"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(fourthOrder_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 4);
    w.over(0, extent_).reads<float>(0, "size").over(1, extent_).reads<float>(1, "footprint").over(2, extent_).reads<uint32_t>(2, "n");
    w.over(3, {1, 1, 1}).reads<float>(3, "filterMu");
    return w.gives({type(), Domain::ViewSample, extent_, {plane<float>("Omega")}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto size = ctx.inputs.at(0)->floats("size"), footprint = ctx.inputs.at(1)->floats("footprint");
    const auto n = ctx.inputs.at(2)->plane<uint32_t>("n");
    const float mu = ctx.inputs.at(3)->floats("filterMu")[0];
    const auto omega = ctx.result->writable<float>("Omega");
    const bool complete = ctx.arena->parallelFor(
        size.size(), 1 << 13,
        [&](size_t from, size_t to) {
          for (size_t p = from; p < to; ++p) {
            if (!(size[p] > 0.0f) || n[p] == 0) continue;
            const float width = formulas::aaPredictedWidth(size[p], float(n[p]), fourthOrder_) * footprint[p];
            const float w = mu / (3.0f * width);
            omega[p] = std::isfinite(w) ? w : 0.0f;
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "shadow_predicted_width: stopped");
    return TermPtr(ctx.result);
  }

 private:
  bool fourthOrder_;
  Extent extent_;
};

}  // namespace

NodePtr makeShadowPenumbra(int radiusPx, float sigma, const Extent& extent) { return std::make_shared<ShadowPenumbra>(radiusPx, sigma, extent); }
NodePtr makeShadowPenumbraCount(uint32_t pilot, uint32_t samples, const Extent& extent) {
  return std::make_shared<ShadowPenumbraCount>(pilot, samples, extent);
}
NodePtr makeShadowPredictedWidth(bool fourthOrder, const Extent& extent) { return std::make_shared<ShadowPredictedWidth>(fourthOrder, extent); }

}  // namespace filters
}  // namespace gobo

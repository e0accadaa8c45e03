// SPDX-License-Identifier: Apache-2.0
#include "filters/sheared/shear.h"

#include <algorithm>
#include <cmath>

#include "filters/axis_aligned/predicted_width.h"
#include "filters/sheared/gather_kernels.h"
#include "formulas/axis_aligned.glsl.h"

namespace gobo {
inline namespace filters {
namespace {

constexpr double kEnds = 20.0;           // weight of what the light's ends add; looked at: grids and two-trees, seeds 1 and 2
constexpr float kNoise = 2.5f;           // neighbours' points were dealt to be spread together as they are, not after a shear
constexpr float kWidestOfLight = 0.5f;   // shear times standard deviation, in half edges: beyond it few neighbours' points land on the light
constexpr double kLeastSpread = 3.0e-3;  // of a fourth moment: pilots that met one slope do not say that there is no other

class ShadowShear final : public Node {
 public:
  ShadowShear(const ShadowShearSettings& s, const Extent& extent) : s_(s), extent_(extent) { GOBO_CHECK(s.radiusPx >= 0 && s.widestPx >= 0); }
  std::string type() const override { return "shadow_shear"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    t.halo = s_.radiusPx;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(s_.radiusPx).add(s_.sigma).add(s_.half).add(s_.widestPx).add(s_.always); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 4);
    w.over(0, extent_).reads<float>(0, "sMin").reads<uint8_t>(0, "occluded").over(1, extent_).reads<float>(1, "footprint").reads<uint32_t>(1, "instance");
    w.over(2, extent_).reads<float>(2, "size").over(3, extent_).reads<uint32_t>(3, "n");
    return w.gives({type(), Domain::ViewSample, extent_, {plane<float>("shear"), plane<float>("width")}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override;

 private:
  ShadowShearSettings s_;
  Extent extent_;
};

Result<TermPtr> ShadowShear::run(const RunContext& ctx) const {
  const auto sMin = ctx.inputs.at(0)->floats("sMin"), footprint = ctx.inputs.at(1)->floats("footprint"), size = ctx.inputs.at(2)->floats("size");
  const auto occluded = ctx.inputs[0]->plane<uint8_t>("occluded");
  const auto instance = ctx.inputs[1]->plane<uint32_t>("instance");
  const auto n = ctx.inputs.at(3)->plane<uint32_t>("n");
  const auto shear = ctx.result->writable<float>("shear"), width = ctx.result->writable<float>("width");
  const Extent e = extent_;
  const size_t w = size_t(e.width), rows = size_t(e.height) * size_t(e.layers), all = e.elements();
  // Of each view sample 1, z, z^2, z^3, z^4 if its pilot met an occluder; then sums along rows, then along columns.
  std::vector<float> own(5 * all), row(5 * all);
  bool complete = ctx.arena->parallelFor(
      all, 1 << 13,
      [&](size_t from, size_t to) {
        for (size_t p = from; p < to; ++p) {
          if (instance[p] == ~0u || !occluded[p] || !(sMin[p] > 0.0f)) continue;
          const float z = std::min(footprint[p] / (s_.sigma * sMin[p]), 1.0f / kNarrowestPenumbra);
          if (!std::isfinite(z)) continue;
          float power = 1.0f;
          for (size_t k = 0; k < 5; ++k, power *= z) own[k * all + p] = power;
        }
      },
      ctx.stop);
  complete = complete && ctx.arena->parallelFor(
                             rows, 8,
                             [&](size_t y0, size_t y1) {
                               const int reach = std::min(s_.radiusPx, e.width - 1);
                               for (size_t y = y0; y < y1; ++y)
                                 for (int i = -reach; i <= reach; ++i) {
                                   const size_t p = y * w + size_t(std::max(0, -i)), q = y * w + size_t(std::max(0, i));
                                   sheared::addMoments(w - size_t(std::abs(i)), &instance[p], &instance[q], &own[q], &row[p], all, all);
                                 }
                             },
                             ctx.stop);
  complete = complete && ctx.arena->parallelFor(
                             rows, 8,
                             [&](size_t y0, size_t y1) {
                               std::vector<float> sum(5 * w);
                               for (size_t y = y0; y < y1; ++y) {
                                 const size_t first = y - y % size_t(e.height), last = first + size_t(e.height) - 1, reach = size_t(s_.radiusPx);
                                 std::fill(sum.begin(), sum.end(), 0.0f);
                                 for (size_t r = std::max(first, y - std::min(y, reach)); r <= std::min(last, y + reach); ++r)
                                   sheared::addMoments(w, &instance[y * w], &instance[r * w], &row[r * w], sum.data(), all, w);
                                 for (size_t x = 0; x < w; ++x) {
                                   const size_t p = y * w + x;
                                   if (!(sum[x] > 0.0f) || !(size[p] > 0.0f) || n[p] == 0 || !(footprint[p] > 0.0f)) continue;
                                   double moments[4];
                                   for (size_t k = 0; k < 4; ++k) moments[k] = double(sum[(k + 1) * w + x]) / double(sum[x]);
                                   const ShearChoice c = chooseShear(moments, size[p], float(n[p]), s_);
                                   const float a = c.shear * s_.sigma / footprint[p], t = sheared::kTentOfDeviation * c.width * footprint[p];
                                   if (!(a > 0.0f) || !(t > 0.0f) || !std::isfinite(a) || !std::isfinite(t)) continue;
                                   shear[p] = a;
                                   width[p] = t;
                                 }
                               }
                             },
                             ctx.stop);
  if (!complete) return Status(Code::Cancelled, "shadow_shear: stopped");
  return TermPtr(ctx.result);
}

}  // namespace

ShearChoice chooseShear(const double moments[4], float penumbra, float n, const ShadowShearSettings& s) {
  const double m = moments[0], c2 = std::max(moments[1] - m * m, 0.0);
  const double c4 = std::max(moments[3] - 4 * moments[2] * m + 6 * moments[1] * m * m - 3 * m * m * m * m, 0.0);
  if (!(m > 0.0) || !std::isfinite(m)) return {};
  const float widest = std::min(kWidestOfLight * s.half / (s.sigma * float(m)), float(s.widestPx) / sheared::kTentOfDeviation);
  if (s.always > 0.0f) return {float(m), std::min(s.always, widest)};
  // The fourth power of what one pixel is wrong by, as moments[3] is without a shear. Rounding of c4 must not pass for a spread, or for none.
  const double left = std::max(c4 + kEnds * m * m * c2, kLeastSpread * m * m * m * m);
  const float sheared = float(1.0 / std::sqrt(std::sqrt(left)));
  auto error = [&](float width, float S, bool fourthOrder, float noise) {
    const float bias = (fourthOrder ? AA_BIAS_4 : AA_BIAS_2) * std::pow(width / S, fourthOrder ? AA_BIAS_POWER_4 : AA_BIAS_POWER_2);
    return bias + formulas::aaNoise(n) * noise * (fourthOrder ? AA_GAIN_4 : 1.0f) / (4.0f * 3.14159265f * width * width);
  };
  const float straight = formulas::aaPredictedWidth(penumbra, n, true), along = std::min(formulas::aaPredictedWidth(sheared, n, false), widest);
  if (!(along > 0.0f) || !(error(along, sheared, false, kNoise) < error(straight, penumbra, true, 1.0f))) return {};
  return {float(m), along};
}

NodePtr makeShadowShear(const ShadowShearSettings& settings, const Extent& extent) { return std::make_shared<ShadowShear>(settings, extent); }

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/transfer.h"

#include <algorithm>
#include <array>

#include "filters/stylised/transfer_kernels.h"

namespace gobo {

namespace {

constexpr size_t kRun = 512;  // elements whose sums stay in the first cache

class StyleTransferNode final : public Node {
 public:
  explicit StyleTransferNode(const StyleTransferSettings& s) : s_(s) {
    GOBO_CHECK(s.softness >= 0.0f && s.brightness >= 0.0f && s.brightness <= 1.0f && s.steps >= 1 && s.distances >= 1);
    for (const StyleTransferLayer& l : s.layers)
      GOBO_CHECK(l.softness >= 0.0f && l.brightness >= 0.0f && l.brightness <= 1.0f && l.weight >= 0.0 && l.distance < s.distances);
  }
  std::string type() const override { return "style_transfer"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    if (!s_.varyingInflation) h.add(s_.inflation);
    if (!s_.varyingSoftness) h.add(s_.softness);
    if (!s_.varyingBrightness) h.add(s_.brightness);
    if (s_.transition != StyleTransition::Smoothstep) h.add("transition").add(int(s_.transition));
    if (s_.transition == StyleTransition::Staircase) h.add(s_.steps);
    if (s_.varies()) h.add("varies").add(s_.varyingInflation).add(s_.varyingSoftness).add(s_.varyingBrightness);
    for (const StyleTransferLayer& l : s_.layers) h.add("layer").add(l.inflation).add(l.softness).add(l.brightness).add(l.weight).add(l.distance);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    const size_t tint = size_t(s_.distances), parameters = tint + (s_.tinted ? 1 : 0);
    Wiring w(type(), in, parameters + (s_.varies() ? 1 : 0));
    const Extent extent = w.input(0).extent;
    for (size_t k = 0; k < tint; ++k) w.over(k, extent).reads<float>(k, "D");
    if (s_.tinted) w.over(tint, extent).reads<float>(tint, "V", {3});
    if (s_.varies()) {
      w.over(parameters, extent);
      if (s_.varyingInflation) w.reads<float>(parameters, "inflation");
      if (s_.varyingSoftness) w.reads<float>(parameters, "softness");
      if (s_.varyingBrightness) w.reads<float>(parameters, "brightness");
    }
    return w.gives({"visibility", Domain::ViewSample, extent, {unsetPlane<float>("V", s_.tinted ? 3 : 1)}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    std::vector<std::span<const float>> D;
    for (int k = 0; k < s_.distances; ++k) D.push_back(ctx.inputs.at(size_t(k))->floats("D"));
    const auto V = ctx.result->writable<float>("V");
    const auto tint = s_.tinted ? ctx.inputs[size_t(s_.distances)]->floats("V") : std::span<const float>();
    const Term* varying = s_.varies() ? ctx.inputs.back().get() : nullptr;
    const auto plane = [&](bool varies, const char* name) { return varies ? varying->floats(name) : std::span<const float>(); };
    const auto inflation = plane(s_.varyingInflation, "inflation"), softness = plane(s_.varyingSoftness, "softness"),
               brightness = plane(s_.varyingBrightness, "brightness");
    const bool complete = ctx.arena->parallelFor(
        D[0].size(), 1 << 15,
        [&](size_t begin, size_t end) {
          for (size_t from = begin; from < end; from += kRun) {
            const size_t n = std::min(kRun, end - from);
            std::array<float, kRun> S;
            if (!varying) styleRun(&D[0][from], n, s_, S.data());
            else
              for (size_t k = 0; k < n; ++k) {
                const auto of = [&](std::span<const float> p, float otherwise) { return p.empty() ? otherwise : p[from + k]; };
                StyleTransferSettings here;
                here.inflation = of(inflation, s_.inflation), here.softness = of(softness, s_.softness), here.brightness = of(brightness, s_.brightness);
                here.transition = s_.transition, here.steps = s_.steps;
                styleRun(&D[0][from + k], 1, here, &S[k]);
              }
            if (!s_.layers.empty()) addLayers(D, from, n, S);
            write(tint, from, n, S, V);
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "style_transfer: stopped");
    return TermPtr(ctx.result);
  }

 private:
  void addLayers(const std::vector<std::span<const float>>& D, size_t from, size_t n, std::array<float, kRun>& S) const {
    std::array<double, kRun> sum;
    std::copy_n(S.begin(), n, sum.begin());
    double weights = 1;
    for (const StyleTransferLayer& l : s_.layers) {
      std::array<float, kRun> more;
      StyleTransferSettings layer;
      layer.inflation = l.inflation, layer.softness = l.softness, layer.brightness = l.brightness, layer.transition = s_.transition, layer.steps = s_.steps;
      styleRun(&D[size_t(l.distance)][from], n, layer, more.data());
      for (size_t k = 0; k < n; ++k) sum[k] += l.weight * double(more[k]);
      weights += l.weight;
    }
    for (size_t k = 0; k < n; ++k) S[k] = float(sum[k] / weights);
  }

  static void write(std::span<const float> tint, size_t from, size_t n, const std::array<float, kRun>& S, std::span<float> V) {
    if (tint.empty()) {
      std::copy_n(S.begin(), n, &V[from]);
      return;
    }
    for (size_t k = 0; k < n; ++k) {
      const float* t = &tint[3 * (from + k)];
      const bool lit = std::max({t[0], t[1], t[2]}) >= 0.5f;
      for (size_t c = 0; c < 3; ++c) V[3 * (from + k) + c] = lit ? S[k] * t[c] : S[k];
    }
  }

  StyleTransferSettings s_;
};

}  // namespace

NodePtr makeStyleTransferNode(const StyleTransferSettings& settings) { return std::make_shared<StyleTransferNode>(settings); }

}  // namespace gobo

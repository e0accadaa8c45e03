// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/transfer.h"

#include <algorithm>
#include <array>

#include "filters/stylised/transfer_kernels.h"

namespace gobo {
inline namespace filters {

namespace {

constexpr size_t kRun = 512;  // elements whose sums stay in the first cache

class StyleTransferNode final : public Node {
 public:
  explicit StyleTransferNode(const StyleTransferSettings& s) : s_(s) {
    GOBO_CHECK(s.softness >= 0.0f && s.brightness >= 0.0f && s.brightness <= 1.0f && s.steps >= 1 && s.distances >= 1);
    GOBO_CHECK(s.transition != StyleTransition::Curve || s.curve.size() >= 2);
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
    if (s_.transition == StyleTransition::Curve) {
      h.add(uint64_t(s_.curve.size()));
      for (const float c : s_.curve) h.add(c);
    }
    for (const StyleTransferLayer& l : s_.layers) {
      const auto constant = [&](bool varies, float x) { return varies ? 0.0f : x; };
      h.add("layer").add(constant(l.varyingInflation, l.inflation)).add(constant(l.varyingSoftness, l.softness));
      h.add(constant(l.varyingBrightness, l.brightness)).add(l.weight).add(l.distance);
      if (l.varies()) h.add("varies").add(l.varyingInflation).add(l.varyingSoftness).add(l.varyingBrightness);
    }
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    const size_t tint = size_t(s_.distances), parameters = tint + (s_.tinted ? 1 : 0);
    Wiring w(type(), in, parameters + size_t(parameterInputs()));
    const Extent extent = w.input(0).extent;
    for (size_t k = 0; k < tint; ++k) w.over(k, extent).reads<float>(k, "D");
    if (s_.tinted) w.over(tint, extent).reads<float>(tint, "V", {3});
    size_t next = parameters;
    const auto readsVarying = [&](const auto& l) {
      if (!l.varies()) return;
      w.over(next, extent);
      if (l.varyingInflation) w.reads<float>(next, "inflation");
      if (l.varyingSoftness) w.reads<float>(next, "softness");
      if (l.varyingBrightness) w.reads<float>(next, "brightness");
      ++next;
    };
    readsVarying(s_);
    for (const StyleTransferLayer& l : s_.layers) readsVarying(l);
    return w.gives({"visibility", Domain::ViewSample, extent, {unsetPlane<float>("V", s_.tinted ? 3 : 1)}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    std::vector<std::span<const float>> D;
    for (int k = 0; k < s_.distances; ++k) D.push_back(ctx.inputs.at(size_t(k))->floats("D"));
    const auto V = ctx.result->writable<float>("V");
    const auto tint = s_.tinted ? ctx.inputs[size_t(s_.distances)]->floats("V") : std::span<const float>();
    size_t next = size_t(s_.distances) + (s_.tinted ? 1 : 0);
    const auto planesOf = [&](const auto& l) {
      VaryingPlanes p;
      if (!l.varies()) return p;
      const Term& from = *ctx.inputs.at(next++);
      if (l.varyingInflation) p.inflation = from.floats("inflation");
      if (l.varyingSoftness) p.softness = from.floats("softness");
      if (l.varyingBrightness) p.brightness = from.floats("brightness");
      p.any = true;
      return p;
    };
    std::vector<VaryingPlanes> varying{planesOf(s_)};
    for (const StyleTransferLayer& l : s_.layers) varying.push_back(planesOf(l));
    const std::vector<StyleTransferSettings> settings = layerSettings();
    const bool complete = ctx.arena->parallelFor(
        D[0].size(), 1 << 15,
        [&](size_t begin, size_t end) {
          for (size_t from = begin; from < end; from += kRun) {
            const size_t n = std::min(kRun, end - from);
            std::array<float, kRun> S;
            styleOf(settings[0], varying[0], D[0], from, n, S.data());
            if (!s_.layers.empty()) addLayers(settings, varying, D, from, n, S);
            write(tint, from, n, S, V);
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "style_transfer: stopped");
    return TermPtr(ctx.result);
  }

 private:
  struct VaryingPlanes {
    bool any = false;
    std::span<const float> inflation, softness, brightness;
  };

  int parameterInputs() const {
    int n = s_.varies() ? 1 : 0;
    for (const StyleTransferLayer& l : s_.layers) n += l.varies() ? 1 : 0;
    return n;
  }

  /// What styleRun asks of the style and of each layer.
  std::vector<StyleTransferSettings> layerSettings() const {
    std::vector<StyleTransferSettings> all;
    const auto add = [&](const auto& l) {
      StyleTransferSettings& s = all.emplace_back();
      s.inflation = l.inflation, s.softness = l.softness, s.brightness = l.brightness;
      s.transition = s_.transition, s.steps = s_.steps, s.curve = s_.curve;
    };
    add(s_);
    for (const StyleTransferLayer& l : s_.layers) add(l);
    return all;
  }

  static void styleOf(const StyleTransferSettings& s, const VaryingPlanes& varying, std::span<const float> D, size_t from, size_t n, float* S) {
    if (!varying.any) return styleRun(&D[from], n, s, S);
    StyleTransferSettings here = s;
    for (size_t k = 0; k < n; ++k) {
      const auto of = [&](std::span<const float> p, float otherwise) { return p.empty() ? otherwise : p[from + k]; };
      here.inflation = of(varying.inflation, s.inflation), here.softness = of(varying.softness, s.softness);
      here.brightness = of(varying.brightness, s.brightness);
      styleRun(&D[from + k], 1, here, S + k);
    }
  }

  void addLayers(const std::vector<StyleTransferSettings>& settings, const std::vector<VaryingPlanes>& varying, const std::vector<std::span<const float>>& D,
                 size_t from, size_t n, std::array<float, kRun>& S) const {
    std::array<double, kRun> sum;
    std::copy_n(S.begin(), n, sum.begin());
    double weights = 1;
    for (size_t l = 0; l < s_.layers.size(); ++l) {
      const StyleTransferLayer& layer = s_.layers[l];
      std::array<float, kRun> more;
      styleOf(settings[l + 1], varying[l + 1], D[size_t(layer.distance)], from, n, more.data());
      for (size_t k = 0; k < n; ++k) sum[k] += layer.weight * double(more[k]);
      weights += layer.weight;
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

}  // namespace filters
}  // namespace gobo

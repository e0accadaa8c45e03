// SPDX-License-Identifier: Apache-2.0
// Filter: blocker search by comparison at taps, visible share from a mip chain of exponential variance maps at the penumbra's width (filament#10188).
#include <algorithm>

#include "filters/soft_shadow/blocker_search.h"
#include "filters/soft_shadow/mip_chain.h"
#include "formulas/soft_shadow.glsl.h"

namespace gobo {
inline namespace filters {

using namespace formulas;

namespace {

class ExponentialVarianceSoftNode : public Node {
 public:
  explicit ExponentialVarianceSoftNode(const ExponentialVarianceSoftLookup& l)
      : l_(l), basis_(makeExponentialVarianceBasis(l.cPositive, l.cNegative, 1e-7f, l.bleedingReduction)), search_(l.searchTaps) {}
  std::string type() const override { return "exponential_variance_soft"; }
  NodeTraits traits() const override { return {.tileable = true}; }
  void hashParameters(Hasher& h) const override {
    l_.hash(h);
    h.add(l_.searchTaps);
    basis_->hashEncode(h);
    basis_->hashReconstruct(h);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 3);
    SoftReceivers::reads(w, 0);
    w.over(1, DepthBounds::extent(l_.map.resolution, l_.frames.count)).reads<float>(1, "bounds");
    w.over(2, mipExtent(l_.map.resolution, l_.frames.count)).reads<float>(2, "B", {4});
    return w.gives(visibilityOver(w.input(0)));
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& gbuffer = *ctx.inputs.at(0);
    const DepthBounds bounds(*ctx.inputs.at(1), l_.map.resolution);
    const MipChain chain(*ctx.inputs.at(2), l_.map.resolution);
    const SoftReceivers receivers(gbuffer, l_, false);
    const auto& term = ctx.result;
    const std::span<float> V = term->writable<float>("V");
    const bool done = ctx.arena->parallelFor(
        V.size(), receiverGrain(2.0 * l_.searchTaps),  // probe and search
        [&](size_t begin, size_t end) {
          auto w = std::make_unique<Work>(l_.map.resolution);
          for (size_t first = begin; first < end; first += kN) block(receivers, bounds, chain, first, int(std::min<size_t>(kN, end - first)), &V[first], *w);
        },
        ctx.stop);
    if (!done) return Status(Code::Cancelled, type() + " stopped");
    return TermPtr(term);
  }

 private:
  static constexpr int kN = SoftBlock::kSize;
  struct Work : BlockerSearch::Work {
    using BlockerSearch::Work::Work;
    float d[kN], s[kN], values[4 * kN];
  };

  void block(const SoftReceivers& receivers, const DepthBounds& bounds, const MipChain& chain, size_t first, int count, float* V, Work& w) const {
    search_.run(receivers, bounds, first, count, true, V, w);
    for (int k = 0; k < w.count; ++k) {
      const int i = w.open[k];
      chain.box(w.b.at.face[i], w.b.at.x[i], w.b.at.y[i], w.wx[i], w.wy[i], 4, &w.values[k], kN);
      w.d[k] = w.b.limit[i];
    }
    basis_->reconstruct(w.values, kN, w.d, w.s, size_t(w.count));
    for (int k = 0; k < w.count; ++k) V[w.open[k]] = softVisibility(1.0f - formulas::limit(w.s[k], 0.0f, 1.0f), w.b.above[w.open[k]]);
  }

  ExponentialVarianceSoftLookup l_;
  ShadowBasisPtr basis_;
  BlockerSearch search_;
};

}  // namespace

NodePtr makeExponentialVarianceSoftNode(const ExponentialVarianceSoftLookup& lookup) { return std::make_shared<ExponentialVarianceSoftNode>(lookup); }

}  // namespace filters
}  // namespace gobo

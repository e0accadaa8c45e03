// SPDX-License-Identifier: Apache-2.0
// Filter: blocker search by comparison at taps, visible share from a mip chain of exponential variance maps at the penumbra's width (filament#10188).
#include <algorithm>

#include "filters/soft_shadow/mip_chain.h"
#include "filters/soft_shadow/soft_kernels.h"
#include "formulas/soft_shadow.glsl.h"

namespace gobo {

using namespace formulas;

namespace {

class ExponentialVarianceSoftNode : public Node {
 public:
  explicit ExponentialVarianceSoftNode(const ExponentialVarianceSoftLookup& l)
      : l_(l), basis_(makeExponentialVarianceBasis(l.cPositive, l.cNegative, 1e-7f, l.bleedingReduction)), pattern_(l.searchTaps) {}
  std::string type() const override { return "exponential_variance_soft"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override {
    l_.hash(h);
    h.add(l_.searchTaps);
    basis_->hashEncode(h);
    basis_->hashReconstruct(h);
  }
  size_t outputBytes() const override { return l_.view.viewSamples * 4; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& gbuffer = *ctx.inputs.at(0);
    const DepthBounds bounds(*ctx.inputs.at(1), l_.map.resolution);
    const MipChain chain(*ctx.inputs.at(2), l_.map.resolution);
    const SoftReceivers receivers(gbuffer, l_, false);
    auto term = std::make_shared<Term>("visibility", gbuffer.domain(), gbuffer.extent());
    const std::span<float> V = term->addPlane<float>("V");
    const bool done = ctx.arena->parallelFor(V.size(), 4096, [&](size_t begin, size_t end) {
      auto w = std::make_unique<Work>(l_.map.resolution);
      for (size_t first = begin; first < end; first += kN) block(receivers, bounds, chain, first, int(std::min<size_t>(kN, end - first)), &V[first], *w);
    }, ctx.stop);
    if (!done) return Status(Code::Cancelled, type() + " stopped");
    return TermPtr(term);
  }

 private:
  static constexpr int kN = SoftBlock::kSize;
  struct Work {
    explicit Work(int side) : scratch(2 * size_t(side)) {}
    SoftBlock b;
    SoftTaps taps;
    std::vector<float> scratch;
    int open[kN];
    float z[kN], d[kN], s[kN], values[4 * kN], lo[kN];
  };

  void block(const SoftReceivers& receivers, const DepthBounds& bounds, const MipChain& chain, size_t first, int count, float* V, Work& w) const {
    SoftBlock& b = w.b;
    const int side = bounds.resolution();
    receivers.fill(first, count, b, V);
    int n = 0;
    const auto found = [&](int i, float share, float depth) {
      if (share <= 0.0f) return;   // nothing blocks: lit already
      w.open[n] = i;
      w.z[n++] = softBlocker(depth, share, w.lo[i], b.limit[i], w.lo[i]);
    };
    w.taps.count = 0;
    for (int a = 0; a < b.activeCount; ++a) {
      const int i = b.active[a];
      const SoftSearch s = softSearch(receivers, bounds, b, i);
      if (s.verdict != SoftSearch::Mixed) { V[i] = s.verdict == SoftSearch::Lit ? 1.0f : 0.0f; continue; }
      w.lo[i] = s.lo;
      if (softTexels(s.box) <= pattern_.taps) {
        const SoftSums sums = softDense(bounds.depth(b.at.face[i]), side, b, i, s.box, w.scratch.data());
        found(i, sums.blocked, sums.depth);
      } else {
        w.taps.add(b, i, s.box, mipTexels(side), first + size_t(i));
      }
    }
    softTaps(bounds.depth(0), side, pattern_, w.taps);
    for (int k = 0; k < w.taps.count; ++k) found(w.taps.receiver[k], w.taps.blocked[k], w.taps.depth[k]);
    for (int k = 0; k < n; ++k) {
      const int i = w.open[k], face = b.at.face[i];
      float wx, wy;
      receivers.width(b, i, receivers.metric(face, w.z[k]), wx, wy);
      chain.box(face, b.at.x[i], b.at.y[i], wx, wy, 4, &w.values[k], kN);
      w.d[k] = b.limit[i];
    }
    basis_->reconstruct(w.values, kN, w.d, w.s, size_t(n));
    for (int k = 0; k < n; ++k) V[w.open[k]] = softVisibility(1.0f - formulas::limit(w.s[k], 0.0f, 1.0f), b.above[w.open[k]]);
  }

  ExponentialVarianceSoftLookup l_;
  ShadowBasisPtr basis_;
  SoftPattern pattern_;
};

}  // namespace

NodePtr makeExponentialVarianceSoftNode(const ExponentialVarianceSoftLookup& lookup) { return std::make_shared<ExponentialVarianceSoftNode>(lookup); }

}  // namespace gobo

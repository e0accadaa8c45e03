// SPDX-License-Identifier: Apache-2.0
// Filter: percentage-closer soft shadows (Fernando 2005). `dense` reads every texel of both kernels and is what the pre-filtered techniques
// approximate; otherwise kernels of more texels than taps are read at taps, smaller ones are dense all the same.
#include <algorithm>

#include "filters/soft_shadow/soft_kernels.h"
#include "formulas/soft_shadow.glsl.h"

namespace gobo {

using namespace formulas;

namespace {

class PercentageCloserSoftNode : public Node {
 public:
  explicit PercentageCloserSoftNode(const PercentageCloserSoftLookup& l) : l_(l), search_(l.searchTaps), filter_(l.filterTaps) {}
  std::string type() const override { return "percentage_closer_soft"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override {
    l_.hash(h);
    h.add(l_.dense);
    if (!l_.dense) h.add(l_.searchTaps).add(l_.filterTaps);
  }
  size_t outputBytes() const override { return l_.view.viewSamples * 4; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& gbuffer = *ctx.inputs.at(0);
    const DepthBounds bounds(*ctx.inputs.at(1), l_.map.resolution);
    const SoftReceivers receivers(gbuffer, l_, false);
    auto term = std::make_shared<Term>("visibility", gbuffer.domain(), gbuffer.extent());
    const std::span<float> V = term->addPlane<float>("V");
    const bool done = ctx.arena->parallelFor(V.size(), 4096, [&](size_t begin, size_t end) {
      auto w = std::make_unique<Work>(l_.map.resolution);
      for (size_t first = begin; first < end; first += SoftBlock::kSize)
        block(receivers, bounds, first, int(std::min<size_t>(SoftBlock::kSize, end - first)), &V[first], *w);
    }, ctx.stop);
    if (!done) return Status(Code::Cancelled, type() + " stopped");
    return TermPtr(term);
  }

 private:
  struct Work {
    explicit Work(int side) : scratch(2 * size_t(side)) {}
    SoftBlock b;
    SoftTaps taps;
    SoftSearch search[SoftBlock::kSize];
    std::vector<float> scratch;
    float blocked[SoftBlock::kSize], depth[SoftBlock::kSize];
    int open[SoftBlock::kSize];
  };

  void block(const SoftReceivers& receivers, const DepthBounds& bounds, size_t first, int count, float* V, Work& w) const {
    SoftBlock& b = w.b;
    receivers.fill(first, count, b, V);
    int open = 0;
    for (int k = 0; k < b.activeCount; ++k) {
      const int i = b.active[k];
      w.search[i] = softSearch(receivers, bounds, b, i);
      if (l_.skip && w.search[i].verdict != SoftSearch::Mixed) V[i] = w.search[i].verdict == SoftSearch::Lit ? 1.0f : 0.0f;
      else w.open[open++] = i;
    }
    sums(bounds, search_, first, w, open, [&](int i) { return w.search[i].box; });
    int blocked = 0;
    for (int k = 0; k < open; ++k) {
      const int i = w.open[k];
      if (w.blocked[i] > 0.0f) w.open[blocked++] = i;
      else V[i] = 1.0f;
    }
    sums(bounds, filter_, first, w, blocked, [&](int i) {
      const float z = softBlocker(w.depth[i], w.blocked[i], w.search[i].lo, b.limit[i], w.search[i].lo);
      float wx, wy;
      receivers.width(b, i, receivers.metric(b.at.face[i], z), wx, wy);
      return receivers.box(b, i, wx, wy);
    });
    for (int k = 0; k < blocked; ++k) V[w.open[k]] = softVisibility(w.blocked[w.open[k]], b.above[w.open[k]]);
  }

  // Blocked share and mean of blocked depths over box(i), for the first n open receivers.
  template <typename BoxOf>
  void sums(const DepthBounds& bounds, const SoftPattern& pattern, size_t first, Work& w, int n, const BoxOf& boxOf) const {
    const int side = bounds.resolution();
    w.taps.count = 0;
    for (int k = 0; k < n; ++k) {
      const int i = w.open[k];
      const SoftBox box = boxOf(i);
      if (l_.dense || softTexels(box) <= pattern.taps) {
        const SoftSums s = softDense(bounds.depth(w.b.at.face[i]), side, w.b, i, box, w.scratch.data());
        w.blocked[i] = s.blocked / s.weight;
        w.depth[i] = s.depth / s.weight;
      } else {
        w.taps.add(w.b, i, box, mipTexels(side), first + size_t(i));
      }
    }
    softTaps(bounds.depth(0), side, pattern, w.taps);
    for (int k = 0; k < w.taps.count; ++k) {
      w.blocked[w.taps.receiver[k]] = w.taps.blocked[k];
      w.depth[w.taps.receiver[k]] = w.taps.depth[k];
    }
    for (int k = 0; k < n; ++k)   // a sum of every weight is 1, however it rounds: an umbra is dark whether bounds or texels say so
      if (w.blocked[w.open[k]] > 1.0f - 4e-6f) w.blocked[w.open[k]] = 1.0f;
  }

  PercentageCloserSoftLookup l_;
  SoftPattern search_, filter_;
};

}  // namespace

NodePtr makePercentageCloserSoftNode(const PercentageCloserSoftLookup& lookup) { return std::make_shared<PercentageCloserSoftNode>(lookup); }

}  // namespace gobo

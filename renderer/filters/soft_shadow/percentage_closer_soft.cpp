// SPDX-License-Identifier: Apache-2.0
// Filter: percentage-closer soft shadows (Fernando 2005). `dense` reads every texel of both kernels and is what the pre-filtered techniques
// approximate; otherwise kernels of many more texels than taps are read at taps, smaller ones are dense all the same (blocker_search.h).
#include <algorithm>
#include <atomic>

#include "filters/soft_shadow/blocker_search.h"
#include "formulas/soft_shadow.glsl.h"

namespace gobo {
inline namespace filters {

using namespace formulas;

namespace {

class PercentageCloserSoftNode : public Node {
 public:
  explicit PercentageCloserSoftNode(const PercentageCloserSoftLookup& l) : l_(l), search_(l.dense ? 0 : l.searchTaps), filter_(l.dense ? 0 : l.filterTaps) {}
  std::string type() const override { return "percentage_closer_soft"; }
  NodeTraits traits() const override { return {.tileable = true}; }
  void hashParameters(Hasher& h) const override {
    l_.hash(h);
    h.add(l_.dense);
    if (!l_.dense) h.add(l_.searchTaps).add(l_.filterTaps);
    if (l_.work) h.add("work");
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    SoftReceivers::reads(w, 0);
    w.over(1, DepthBounds::extent(l_.map.resolution, l_.frames.count)).reads<float>(1, "bounds");
    TermShape out = visibilityOver(w.input(0));
    if (l_.work) out.planes.push_back(plane<float>("work", SoftWork::kChannels));
    return w.gives(out);
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& gbuffer = *ctx.inputs.at(0);
    const DepthBounds bounds(*ctx.inputs.at(1), l_.map.resolution);
    const SoftReceivers receivers(gbuffer, l_, false);
    const auto& term = ctx.result;
    const std::span<float> V = term->writable<float>("V");
    const std::span<float> work = l_.work ? term->writable<float>("work") : std::span<float>();
    std::atomic<bool> whole{true};  // no block was given up
    const bool done = ctx.arena->parallelFor(
        V.size(), receiverGrain(texelsRead()),
        [&](size_t begin, size_t end) {
          auto w = std::make_unique<Work>(l_.map.resolution);
          for (size_t first = begin; first < end; first += SoftBlock::kSize) {
            const int count = int(std::min<size_t>(SoftBlock::kSize, end - first));
            if (!block(receivers, bounds, first, count, &V[first], *w, ctx.stop)) {
              whole.store(false, std::memory_order_relaxed);
              return;
            }
            for (int i = 0; l_.work && i < count; ++i) {
              const SoftWork& done = w->done[i];
              float* to = &work[SoftWork::kChannels * (first + size_t(i))];
              to[0] = done.taps, to[1] = done.boxes, to[2] = done.rows, to[3] = done.vectors;
            }
          }
        },
        ctx.stop);
    if (!done || !whole.load()) return Status(Code::Cancelled, type() + " stopped");
    return TermPtr(term);
  }

 private:
  using Work = BlockerSearch::Work;
  /// Texels, at most: probe, search, filter. Of whole maps softSums looks out for a stop between receivers.
  double texelsRead() const { return l_.dense ? 2.0 * l_.map.resolution * l_.map.resolution : 2.0 * l_.searchTaps + l_.filterTaps; }

  /// False: stopped.
  bool block(const SoftReceivers& receivers, const DepthBounds& bounds, size_t first, int count, float* V, Work& w, const StopToken& stop) const {
    if (!search_.run(receivers, bounds, first, count, l_.skip, V, w, stop)) return false;
    if (!softSums(SoftAsk::Share, receivers, bounds, filter_, first, w, stop, [&](int i) { return receivers.box(w.b, i, w.wx[i], w.wy[i]); })) return false;
    for (int k = 0; k < w.count; ++k) {
      const int i = w.open[k];
      // A sum of every weight is 1, however it rounds: an umbra is dark whether bounds or texels say so.
      V[i] = w.blocked[i] > 1.0f - 4e-6f ? 0.0f : softVisibility(w.blocked[i], w.b.above[i]);
    }
    return true;
  }

  PercentageCloserSoftLookup l_;
  BlockerSearch search_;
  SoftPattern filter_;
};

}  // namespace

NodePtr makePercentageCloserSoftNode(const PercentageCloserSoftLookup& lookup) { return std::make_shared<PercentageCloserSoftNode>(lookup); }

}  // namespace filters
}  // namespace gobo

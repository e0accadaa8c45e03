// SPDX-License-Identifier: Apache-2.0
// Filter: variance soft shadow maps (Yang, Dong, Feng, Seidel, Kautz 2010). Mean and variance of depth over a box give the visible share by
// Chebyshev's bound and, with it, the blockers' mean depth: z = (E[z] - P d) / (1 - P), taking what is visible to lie at the receiver.
// Where the mean lies behind the receiver the bound says nothing; with `subdivide` such boxes are cut into four, twice at most, the parts that the
// depth bounds decide are taken from them, and what then remains is compared at 4 x 4 texels.
#include <algorithm>
#include <cmath>

#include "filters/soft_shadow/moment_sums.h"
#include "formulas/soft_shadow.glsl.h"
#include "formulas/variance_shadow_map.glsl.h"

namespace gobo {
inline namespace filters {

using namespace formulas;

namespace {

/// Shares of a box: blocked, and the sum of the blockers' depths.
struct Blocked {
  float share = 0, depth = 0;
};

class VarianceSoftNode : public Node {
 public:
  explicit VarianceSoftNode(const VarianceSoftLookup& l) : l_(l) {}
  std::string type() const override { return "variance_soft"; }
  NodeTraits traits() const override { return {.tileable = true}; }
  void hashParameters(Hasher& h) const override {
    l_.hash(h);
    h.add(l_.minVariance).add(l_.subdivide);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 3);
    SoftReceivers::reads(w, 0);
    w.over(1, DepthBounds::extent(l_.map.resolution, l_.frames.count)).reads<float>(1, "bounds");
    w.over(2, MomentSums::extent(l_.map.resolution, l_.frames.count)).reads<double>(2, "sums", {2});
    return w.gives(visibilityOver(w.input(0)));
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& gbuffer = *ctx.inputs.at(0);
    const DepthBounds bounds(*ctx.inputs.at(1), l_.map.resolution);
    const MomentSums sums(*ctx.inputs.at(2), l_.map.resolution);
    const SoftReceivers receivers(gbuffer, l_, false);
    const auto& term = ctx.result;
    const std::span<float> V = term->writable<float>("V");
    const bool done = ctx.arena->parallelFor(
        V.size(), 4096,
        [&](size_t begin, size_t end) {
          auto b = std::make_unique<SoftBlock>();
          std::vector<SoftSearch> searches(SoftBlock::kSize);
          for (size_t first = begin; first < end; first += SoftBlock::kSize) {
            receivers.fill(first, int(std::min<size_t>(SoftBlock::kSize, end - first)), *b, &V[first]);
            softSearches(receivers, bounds, *b, searches.data());
            for (int k = 0; k < b->activeCount; ++k)
              V[first + size_t(b->active[k])] = visibility({receivers, bounds, sums, *b, b->active[k]}, searches[size_t(b->active[k])]);
          }
        },
        ctx.stop);
    if (!done) return Status(Code::Cancelled, type() + " stopped");
    return TermPtr(term);
  }

 private:
  struct At {
    const SoftReceivers& receivers;
    const DepthBounds& bounds;
    const MomentSums& sums;
    const SoftBlock& b;
    int i;
  };

  float visibility(const At& at, const SoftSearch& s) const {
    if (s.verdict != SoftSearch::Mixed) return s.verdict == SoftSearch::Lit ? 1.0f : 0.0f;
    const float d = at.b.limit[at.i];
    const Blocked search = blocked(at, s.box, 0);
    const float z = softBlocker(search.depth, search.share, s.lo, d, s.lo);
    float wx, wy;
    at.receivers.width(at.b, at.i, at.receivers.metric(at.b.at.face[at.i], z), wx, wy);
    const float gate = softGate(search.share, 0.001f, 0.005f);
    return softVisibility(blocked(at, at.receivers.box(at.b, at.i, wx, wy), 0).share * gate, at.b.above[at.i]);
  }

  // What lies nearer than this in a box blocks: the receiver's depth, or its plane's at the box's centre where that is nearer.
  float nearest(const At& at, const SoftBox& box) const {
    const SoftBlock& b = at.b;
    const int i = at.i;
    const float x = 0.5f * (box.x0 + box.x1) - 0.5f - b.at.x[i], y = 0.5f * (box.y0 + box.y1) - 0.5f - b.at.y[i];
    const float rise = b.b[i] + b.bx[i] * x + b.by[i] * y;
    if (!(rise < 0.0f)) return b.limit[i];
    const float plane = (b.a[i] + b.ax[i] * x + b.ay[i] * y) / -rise;
    return std::clamp(plane - l_.map.bias, 0.0f, b.limit[i]);
  }

  Blocked blocked(const At& at, const SoftBox& box, int cuts) const {
    const int face = at.b.at.face[at.i];
    float m1, m2;
    at.sums.box(face, box, m1, m2);
    const float d = nearest(at, box), t = d - 0.5f;
    if (m1 < t || !l_.subdivide) {
      const float visible = vsmChebyshev(m1, m2, t, l_.minVariance);
      return {1.0f - visible, std::max(softVarianceBlocked(m1 + 0.5f, visible, d), 0.0f)};
    }
    if (cuts == 2) return compared(at, box);
    const float x = 0.5f * (box.x0 + box.x1), y = 0.5f * (box.y0 + box.y1);
    const SoftBox parts[4] = {{box.x0, x, box.y0, y}, {x, box.x1, box.y0, y}, {box.x0, x, y, box.y1}, {x, box.x1, y, box.y1}};
    Blocked all;
    for (const SoftBox& p : parts) {
      const int last = at.bounds.resolution() - 1;
      float lo, hi;
      at.bounds.range(face, int(p.x0), int(p.y0), std::min(int(std::ceil(p.x1)) - 1, last), std::min(int(std::ceil(p.y1)) - 1, last), lo, hi);
      const SoftSearch::Verdict v = softVerdict(at.b, at.i, p, lo, hi);
      if (v == SoftSearch::Lit) continue;
      Blocked part;
      if (v == SoftSearch::Dark) {
        at.sums.box(face, p, m1, m2);
        part = {1.0f, m1 + 0.5f};
      } else {
        part = blocked(at, p, cuts + 1);
      }
      all.share += 0.25f * part.share;
      all.depth += 0.25f * part.depth;
    }
    return all;
  }

  Blocked compared(const At& at, const SoftBox& box) const {
    const SoftBlock& b = at.b;
    const int i = at.i, last = at.bounds.resolution() - 1;
    const float* z = at.bounds.depth(b.at.face[i]);
    Blocked all;
    for (int k = 0; k < 16; ++k) {
      const int x = std::min(int(box.x0 + (box.x1 - box.x0) * (float(k % 4) + 0.5f) * 0.25f), last);
      const int y = std::min(int(box.y0 + (box.y1 - box.y0) * (float(k / 4) + 0.5f) * 0.25f), last);
      const float depth = z[size_t(y) * size_t(last + 1) + size_t(x)];
      const float height = softHeight(b.a[i], b.ax[i], b.ay[i], b.b[i], b.bx[i], b.by[i], float(x) - b.at.x[i], float(y) - b.at.y[i], depth);
      const float w = softBlocks(depth, b.limit[i], height, b.margin[i]) * 0.0625f;
      all.share += w;
      all.depth += w * depth;
    }
    return all;
  }

  VarianceSoftLookup l_;
};

}  // namespace

NodePtr makeVarianceSoftNode(const VarianceSoftLookup& lookup) { return std::make_shared<VarianceSoftNode>(lookup); }

}  // namespace filters
}  // namespace gobo

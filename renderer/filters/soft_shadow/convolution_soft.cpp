// SPDX-License-Identifier: Apache-2.0
// Filter: convolution soft shadow maps (Annen et al. 2008; thesis ch. 8). Boxes of Fourier images give the blockers' mean depth and, at the
// penumbra's width, the visible share: the same cost for every width.
//   fbar(d, z) ~ 1 - base - scale sum_k w_k sin(c_k (z - d + o));   blocked = E[fbar],   z_avg = E[z fbar] / E[fbar]   (eq. 8.4, 8.8)
// both from one lookup and not limited before the division. Beyond the thesis, two errors of a short series are known in closed form and taken
// out (softUnmix): the receiver's own plane, which reads as blocked in part where it is tilted to the map (or where there is no offset), and
// blockers near the receiver, which read as fbar(d, z_avg) < 1, so that contacts of low orders leak light (digest 7.10, 7.11).
#include <algorithm>
#include <optional>

#include "filters/shadow_map/summed_area.h"
#include "filters/soft_shadow/convolution_soft_kernels.h"
#include "filters/soft_shadow/mip_chain.h"
#include "filters/soft_shadow/soft_receivers.h"
#include "formulas/soft_shadow.glsl.h"

namespace gobo {
inline namespace filters {

using namespace formulas;

namespace {

class ConvolutionSoftBasis final : public ShadowBasis {
 public:
  explicit ConvolutionSoftBasis(int order) : order_(order) { GOBO_CHECK(order >= 1 && order <= kMaxConvolutionOrder); }
  const char* name() const override { return "convolution_soft"; }
  int channels() const override { return 4 * order_ + 1; }
  void hashEncode(Hasher& h) const override { h.add(order_); }
  void hashReconstruct(Hasher&) const override {}
  bool bounded() const override { return true; }
  void encode(const float* z, float* out, size_t n) const override { encodeConvolutionSoft(z, out, n, order_); }
  /// The hard shadow of the first 2 M images, with the plain offset.
  void reconstruct(const float* v, size_t stride, const float* d, float* s, size_t n) const override {
    const ConvolutionCorrection c = convolutionCorrection(v1::ConvolutionShadow::OFFSET, order_, 0);
    reconstructConvolution(v, stride, d, s, n, {order_, 0.0f, float(c.scale), float(c.offset * (1.0 + 1.0 / order_)), false});
  }

 private:
  int order_;
};

using Soft = v1::ConvolutionSoftShadow;

class ConvolutionSoftNode : public Node {
 public:
  explicit ConvolutionSoftNode(const ConvolutionSoftLookup& l) : l_(l) {
    const ConvolutionCorrection c = convolutionCorrection(l.correction, l.order, 0);
    series_ = {l.order, 0.0f, float(c.scale), float(c.offset * (1.0 + 1.0 / l.order)), l.correction == v1::ConvolutionShadow::SCALING};
  }
  std::string type() const override { return "convolution_soft"; }
  NodeTraits traits() const override { return {.tileable = true}; }
  void hashParameters(Hasher& h) const override {
    l_.hash(h);
    h.add(l_.order).add(int(l_.correction)).add(int(l_.search)).add(l_.sharpening).add(mips()).add(l_.map.slopeBias);
    if (l_.sharpening > 0.0f) h.add(l_.sharpeningExtent);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 3);
    SoftReceivers::reads(w, 0);
    w.over(1, DepthBounds::extent(l_.map.resolution, l_.frames.count)).reads<float>(1, "bounds");
    if (mips()) w.over(2, mipExtent(l_.map.resolution, l_.frames.count)).reads<float>(2, "B", {4 * l_.order + 1});
    else w.over(2, SummedArea::extent(l_.map.resolution, l_.frames.count)).reads<uint32_t>(2, "sums", {4 * l_.order + 1});
    return w.gives(visibilityOver(w.input(0)));
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& gbuffer = *ctx.inputs.at(0);
    const DepthBounds bounds(*ctx.inputs.at(1), l_.map.resolution);
    const SoftReceivers receivers(gbuffer, l_, true);
    std::optional<SummedArea> sums;
    std::optional<MipChain> chain;
    if (mips()) chain.emplace(*ctx.inputs.at(2), l_.map.resolution);
    else sums.emplace(*ctx.inputs.at(2), l_.map.resolution);
    const auto& term = ctx.result;
    const std::span<float> V = term->writable<float>("V");
    const bool done = ctx.arena->parallelFor(
        V.size(), 4096,
        [&](size_t begin, size_t end) {
          auto w = std::make_unique<Work>(images() * 2 + 1);
          w->sums = sums ? &*sums : nullptr;
          w->chain = chain ? &*chain : nullptr;
          for (size_t first = begin; first < end; first += kN) block(receivers, bounds, first, int(std::min<size_t>(kN, end - first)), &V[first], *w);
        },
        ctx.stop);
    if (!done) return Status(Code::Cancelled, type() + " stopped");
    return TermPtr(term);
  }

 private:
  static constexpr int kN = SoftBlock::kSize;
  bool mips() const { return l_.map.lookup == v1::ShadowMapSettings::TRILINEAR; }
  int images() const { return 2 * l_.order; }

  struct Work {
    SoftSearch search[SoftBlock::kSize];
    explicit Work(int channels) : values(size_t(channels) * kN) {}
    const SummedArea* sums = nullptr;
    const MipChain* chain = nullptr;
    SoftBlock b;
    std::vector<float> values;
    // Receivers that are looked up, side by side.
    int n = 0, open[kN];
    float wx[kN], wy[kN], lo[kN], d[kN], shift[kN], x[kN], y[kN], self[kN], selfDepth[kN], full[kN], blocked[kN], depth[kN], gate[kN], z[kN];
  };

  // Images [0, count) over the open receivers' boxes into values[k * kN + i]; and what their own planes read there.
  void fetch(Work& w, int count) const {
    float one[4 * kMaxConvolutionOrder + 1];
    for (int k = 0; k < w.n; ++k) {
      const int i = w.open[k], face = w.b.at.face[i];
      if (w.chain) {
        w.chain->box(face, w.b.at.x[i], w.b.at.y[i], w.wx[k], w.wy[k], count, &w.values[size_t(k)], kN);
      } else {
        w.sums->box(face, w.b.at.x[i], w.b.at.y[i], w.wx[k], w.wy[k], 0, count, one);
        for (int c = 0; c < count; ++c) w.values[size_t(c) * kN + size_t(k)] = one[c];
      }
      w.x[k] = std::min(0.5f * w.wx[k] * std::fabs(w.b.at.slopeX[i]), 1.0f);
      w.y[k] = std::min(0.5f * w.wy[k] * std::fabs(w.b.at.slopeY[i]), 1.0f);
      // Towards the light by what the plane rises over the kernel beyond the series' own offset, but not past the middle to the nearest blocker.
      const float shift = std::min(std::max(l_.map.slopeBias * (w.x[k] + w.y[k]) - series_.offset, 0.0f), 0.5f * std::max(w.b.limit[i] - w.lo[k], 0.0f));
      w.d[k] = w.b.limit[i] - shift;
      w.shift[k] = shift + l_.map.bias;
    }
    convolutionSelf(w.x, w.y, w.d, w.shift, w.self, w.selfDepth, size_t(w.n), series_);
  }

  void blockers(Work& w) const {
    fetch(w, 2 * images() + 1);
    convolutionBlockers(w.values.data(), kN, w.d, w.self, w.selfDepth, w.blocked, w.depth, size_t(w.n), series_);
    for (int k = 0; k < w.n; ++k) { w.z[k] = softBlocker(w.depth[k], w.blocked[k], w.lo[k], std::max(w.b.limit[w.open[k]], w.lo[k]), w.lo[k]); }
    convolutionFull(w.z, w.d, w.full, size_t(w.n), series_);
  }

  void cut(const SoftReceivers& receivers, Work& w) const {  // kernels at the plane of z
    for (int k = 0; k < w.n; ++k) receivers.width(w.b, w.open[k], receivers.metric(w.b.at.face[w.open[k]], w.z[k]), w.wx[k], w.wy[k]);
  }

  void block(const SoftReceivers& receivers, const DepthBounds& bounds, size_t first, int count, float* V, Work& w) const {
    SoftBlock& b = w.b;
    receivers.fill(first, count, b, V);
    w.n = 0;
    softSearches(receivers, bounds, b, w.search);
    for (int a = 0; a < b.activeCount; ++a) {
      const int i = b.active[a];
      const SoftSearch& s = w.search[i];
      if (s.verdict != SoftSearch::Mixed) {
        V[i] = s.verdict == SoftSearch::Lit ? 1.0f : 0.0f;
        continue;
      }
      const int k = w.n++;
      w.open[k] = i;
      w.lo[k] = s.lo;
      w.wx[k] = s.wx;
      w.wy[k] = s.wy;
      if (l_.search != Soft::Z_MIN) receivers.width(b, i, receivers.metric(b.at.face[i], 0.0f), w.wx[k], w.wy[k]);
    }
    if (w.n == 0) return;
    blockers(w);
    for (int step = 0; l_.search == Soft::ITERATED && step < 2; ++step) {  // the plane of the mean blocker (digest 7.4)
      cut(receivers, w);
      blockers(w);
    }
    for (int k = 0; k < w.n; ++k) {
      const float full = std::max(w.full[k], 0.1f);
      w.gate[k] = softGate(w.blocked[k], 0.002f * full, 0.01f * full);
    }
    cut(receivers, w);
    fetch(w, images());
    convolutionFull(w.z, w.d, w.full, size_t(w.n), series_);
    reconstructConvolution(w.values.data(), kN, w.d, w.blocked, size_t(w.n), series_);
    for (int k = 0; k < w.n; ++k) {
      const int i = w.open[k];
      const float blocked = limit(softUnmix(1.0f - w.blocked[k], w.self[k], w.full[k]), 0.0f, 1.0f) * w.gate[k];
      float s = softVisibility(blocked, b.above[i]);
      if (l_.sharpening > 0.0f) s = softSharpen(s, b.at.d[i] - w.z[k], l_.sharpening, l_.sharpeningExtent);
      V[i] = s;
    }
  }

  ConvolutionSoftLookup l_;
  ConvolutionParameters series_;
};

}  // namespace

ShadowBasisPtr makeConvolutionSoftBasis(int order) { return std::make_shared<ConvolutionSoftBasis>(order); }
NodePtr makeConvolutionSoftNode(const ConvolutionSoftLookup& lookup) { return std::make_shared<ConvolutionSoftNode>(lookup); }

}  // namespace filters
}  // namespace gobo

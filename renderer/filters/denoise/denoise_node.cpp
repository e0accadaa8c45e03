// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/denoise_node.h"

#include <algorithm>

#include "filters/denoise/noisy_picture.h"
#include "filters/denoise/similar.h"

namespace gobo::denoise {

namespace {

class DenoiseNode final : public Node {
 public:
  DenoiseNode(DenoiserPtr denoiser, int width, int height, uint32_t samples, uint32_t first, bool judged)
      : meanAlone_(!judged && !denoiser->looksAtHalves()), denoiser_(std::move(denoiser)), width_(width), height_(height), samples_(samples), first_(first) {}
  std::string type() const override { return "denoise"; }
  int version() const override { return denoiser_->version(); }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    t.halo = denoiser_->halo();
    return t;
  }
  void hashParameters(Hasher& h) const override {
    h.add(std::string(denoiser_->name())).add(width_).add(height_).add(samples_).add(first_);
    denoiser_->hashParameters(h);
    if (!denoiser_->looksAtHalves() && !meanAlone_) h.add(std::string("halves"));
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    const Extent all{width_, height_, 1};
    Wiring w(type(), in, 2);
    readFeatures(w, 0, all);
    w.over(1, all);
    for (const char* name : {"mean", "a", "b", "variance"}) w.reads<float>(1, name, {3});
    for (const auto& [input, name] : {std::pair<size_t, const char*>{0, "even"}, {0, "alpha"}, {0, "blur"}, {1, "curvature"}})  // where they are
      if (input < in.size() && in[input].find(name)) w.reads<float>(input, name);
    TermShape out{"denoised", Domain::Pixel, all, {unsetPlane<float>("rgb", 3), unsetPlane<float>("a", 3), unsetPlane<float>("b", 3)}};
    return w.gives(std::move(out));
  }
  size_t workingBytes() const override { return denoiser_->workingBytes(width_, height_); }
  Cost cost(const TermShape& result, uint32_t) const override { return {0.0, denoiser_->nsPerPixel() * double(result.extent.elements())}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    NoisyPicture p = noisyPicture(*ctx.inputs[0], *ctx.inputs[1], samples_, first_);
    if (meanAlone_) {
      p.a = p.b = p.mean;
      p.halves = false;
    }
    const auto& out = ctx.result;
    const auto rgb = out->writable<float>("rgb"), a = out->writable<float>("a"), b = out->writable<float>("b");
    if (!denoiser_->run(p, a, b, *ctx.arena, ctx.stop)) return Status(Code::Cancelled, "stopped");
    const bool complete = ctx.arena->parallelFor(
        rgb.size(), 1 << 15,
        [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) {
            if (!p.halves) b[i] = a[i];
            rgb[i] = b[i] + p.shareOfA * (a[i] - b[i]);
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(out);
  }

 private:
  bool meanAlone_;
  DenoiserPtr denoiser_;
  int width_, height_;
  uint32_t samples_, first_;
};

}  // namespace

NodePtr makeDenoiseNode(DenoiserPtr denoiser, int width, int height, uint32_t samples, uint32_t first, bool judged) {
  return std::make_shared<DenoiseNode>(std::move(denoiser), width, height, samples, first, judged);
}

}  // namespace gobo::denoise

// SPDX-License-Identifier: Apache-2.0
#include "filters/with_alpha.h"

#include <algorithm>

#include "terms/dropped_samples.h"

namespace gobo {
inline namespace filters {

namespace {

class WithAlphaNode final : public Node {
 public:
  WithAlphaNode(int width, int height) : width_(width), height_(height) {}
  std::string type() const override { return "with_alpha"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(width_).add(height_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    w.over(0, {width_, height_, 1}).reads<float>(0, "rgb", {3}).over(1, {width_, height_, 1}).reads<float>(1, "s0", {3});
    TermShape out{"picture", Domain::Pixel, {width_, height_, 1}, {unsetPlane<float>("rgba", 4)}};
    passOnDropped(w.input(0), out);
    return w.gives(std::move(out));
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto rgb = ctx.inputs[0]->floats("rgb"), clear = ctx.inputs[1]->floats("s0");
    const auto& out = ctx.result;
    const auto rgba = out->writable<float>("rgba");
    const bool complete = ctx.arena->parallelFor(
        size_t(width_) * size_t(height_), 1 << 14,
        [&](size_t b, size_t e) {
          for (size_t p = b; p < e; ++p) {
            for (size_t c = 0; c < 3; ++c) rgba[4 * p + c] = rgb[3 * p + c];
            rgba[4 * p + 3] = std::clamp(1.0f - (clear[3 * p] + clear[3 * p + 1] + clear[3 * p + 2]) / 3.0f, 0.0f, 1.0f);
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    passOnDropped(*ctx.inputs[0], *out);
    return TermPtr(out);
  }

 private:
  int width_, height_;
};

}  // namespace

NodePtr makeWithAlphaNode(int width, int height) { return std::make_shared<WithAlphaNode>(width, height); }

}  // namespace filters
}  // namespace gobo

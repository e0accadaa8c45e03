// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/transfer.h"

#include <algorithm>

#include "filters/stylised/transfer_kernels.h"

namespace gobo {

namespace {

class StyleTransferNode final : public Node {
 public:
  explicit StyleTransferNode(const StyleTransferSettings& s) : s_(s) { GOBO_CHECK(s.softness >= 0.0f && s.brightness >= 0.0f && s.brightness <= 1.0f); }
  std::string type() const override { return "style_transfer"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    h.add(s_.inflation);
    h.add(s_.softness);
    h.add(s_.brightness);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1, 2);
    w.reads<float>(0, "D");
    if (w.size() == 2) w.over(1, w.input(0).extent).reads<float>(1, "V", {3});
    return w.gives({"visibility", Domain::ViewSample, w.input(0).extent, {unsetPlane<float>("V", w.size() == 2 ? 3 : 1)}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto D = ctx.inputs.at(0)->floats("D");
    const auto V = ctx.result->writable<float>("V");
    const auto tint = ctx.inputs.size() == 2 ? ctx.inputs[1]->floats("V") : std::span<const float>();
    const bool complete = ctx.arena->parallelFor(
        D.size(), 1 << 15,
        [&](size_t begin, size_t end) {
          if (tint.empty()) return styleRun(D.data() + begin, end - begin, s_, V.data() + begin);
          for (size_t e = begin; e < end; ++e) {
            float s;
            styleRun(&D[e], 1, s_, &s);
            const bool lit = std::max({tint[3 * e], tint[3 * e + 1], tint[3 * e + 2]}) >= 0.5f;
            for (size_t c = 0; c < 3; ++c) V[3 * e + c] = lit ? s * tint[3 * e + c] : s;
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "style_transfer: stopped");
    return TermPtr(ctx.result);
  }

 private:
  StyleTransferSettings s_;
};

}  // namespace

NodePtr makeStyleTransferNode(const StyleTransferSettings& settings) { return std::make_shared<StyleTransferNode>(settings); }

}  // namespace gobo

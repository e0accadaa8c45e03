// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/style_levels.h"

#include <algorithm>

namespace gobo {
inline namespace filters {

namespace {

class StyleLevelsNode final : public FoldNode {
 public:
  StyleLevelsNode(const Extent& extent, int levels, bool coloured) : extent_(extent), levels_(levels), coloured_(coloured) { GOBO_CHECK(levels >= 1); }
  std::string type() const override { return "style_levels"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    h.add(levels_);
    h.add(coloured_);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, size_t(fixedInputs() + levels_));
    for (size_t i = 0; i < in.size() && w.ok(); ++i) w.over(i, extent_).reads<float>(i, "V", {i < size_t(fixedInputs()) ? 3 : 1});
    return w.gives({"visibility", Domain::ViewSample, extent_, {unsetPlane<float>("V", coloured_ ? 3 : 1)}});
  }
  size_t workingBytes() const override { return extent_.elements() * sizeof(double); }
  int fixedInputs() const override { return coloured_ ? 1 : 0; }
  int stride() const override { return 1; }

  struct Sum final : State {
    std::vector<double> values;
    TermPtr tint;
  };
  std::unique_ptr<State> begin(const RunContext&, const std::vector<TermPtr>& fixed) const override {
    auto sum = std::make_unique<Sum>();
    sum->values.resize(extent_.elements());
    if (coloured_) sum->tint = fixed.at(0);
    return sum;
  }
  Status step(const RunContext& ctx, State& state, int, const std::vector<TermPtr>& inputs) const override {
    std::vector<double>& values = static_cast<Sum&>(state).values;
    const auto S = inputs.at(0)->floats("V");
    const bool complete = ctx.arena->parallelFor(
        values.size(), 1 << 15,
        [&](size_t begin, size_t end) {
          for (size_t e = begin; e < end; ++e) values[e] += double(S[e]);
        },
        ctx.stop);
    return complete ? Status() : stopped();
  }
  Result<TermPtr> finish(const RunContext& ctx, std::unique_ptr<State> state) const override {
    const Sum& sum = static_cast<const Sum&>(*state);
    const auto V = ctx.result->writable<float>("V");
    const auto tint = coloured_ ? sum.tint->floats("V") : std::span<const float>();
    const float first = 0.5f / float(levels_);
    const bool complete = ctx.arena->parallelFor(
        sum.values.size(), 1 << 15,
        [&](size_t begin, size_t end) {
          for (size_t e = begin; e < end; ++e) {
            const float s = float(sum.values[e] / levels_);
            if (!coloured_) {
              V[e] = s;
              continue;
            }
            const float most = std::max({tint[3 * e], tint[3 * e + 1], tint[3 * e + 2]});
            for (size_t c = 0; c < 3; ++c) V[3 * e + c] = most >= first ? s * (tint[3 * e + c] / most) : s;
          }
        },
        ctx.stop);
    if (!complete) return stopped();
    return TermPtr(ctx.result);
  }

 private:
  static Status stopped() { return Status(Code::Cancelled, "style_levels: stopped"); }
  Extent extent_;
  int levels_;
  bool coloured_;
};

}  // namespace

NodePtr makeStyleLevelsNode(const Extent& extent, int levels, bool coloured) { return std::make_shared<StyleLevelsNode>(extent, levels, coloured); }

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "filters/multiple_axis_aligned/bands.h"

#include <cmath>

namespace gobo {
inline namespace filters {
namespace {

class LightBandNode final : public Node {
 public:
  explicit LightBandNode(int band) : band_(band) { GOBO_CHECK(band >= 0); }
  std::string type() const override { return "light_band"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(band_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    w.reads<float>(0, "band", {w.channels(0, "band")}).require(band_ < w.channels(0, "band"), "input 0 has no such band");
    return w.gives({"visibility", Domain::ViewSample, w.input(0).extent, {plane<float>("V")}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto in = ctx.inputs.at(0)->floats("band");
    const auto V = ctx.result->writable<float>("V");
    const size_t J = size_t(ctx.inputs[0]->channels("band"));
    for (size_t p = 0; p < V.size(); ++p) {
      if (p % (1 << 16) == 0 && ctx.stop.stopRequested()) return Status(Code::Cancelled, "light_band: stopped");
      V[p] = in[J * p + size_t(band_)];
    }
    return TermPtr(ctx.result);
  }

 private:
  int band_;
};

class LightBandSumNode final : public Node {
 public:
  std::string type() const override { return "light_band_sum"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher&) const override {}
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1, 16);
    for (size_t i = 0; i < w.size(); ++i) w.over(i, w.input(0).extent).reads<float>(i, "V");
    return w.gives({"visibility", Domain::ViewSample, w.input(0).extent, {plane<float>("V")}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto V = ctx.result->writable<float>("V");
    for (const TermPtr& in : ctx.inputs) {
      if (ctx.stop.stopRequested()) return Status(Code::Cancelled, "light_band_sum: stopped");
      const auto band = in->floats("V");
      for (size_t p = 0; p < V.size(); ++p) V[p] += band[p];
    }
    for (float& v : V) {
      if (!std::isfinite(v)) return internalError("light_band_sum: visibility is not finite");
      v = clamp01(v);
    }
    return TermPtr(ctx.result);
  }
};

}  // namespace

NodePtr makeLightBand(int band) { return std::make_shared<LightBandNode>(band); }
NodePtr makeLightBandSum() { return std::make_shared<LightBandSumNode>(); }

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "filters/slice_sum.h"

#include <algorithm>

#include "terms/dropped_samples.h"

namespace gobo {

namespace {

class SliceSumNode final : public FoldNode {
 public:
  SliceSumNode(std::vector<SlicePlane> outputs, int w, int h, int slices) : outputs_(std::move(outputs)), width_(w), height_(h), slices_(slices) {}
  std::string type() const override { return "slice_sum"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.linearPerGroup = true;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    h.add(width_).add(height_).add(slices_);
    for (const SlicePlane& o : outputs_) h.add(o.plane).add(o.channels).add(o.mean);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, outputs_.size() * size_t(slices_));
    TermShape out{"picture", Domain::Pixel, extent(), {}};
    for (size_t o = 0; o < outputs_.size(); ++o) out.planes.push_back(unsetPlane<float>(slicedPlane(o), outputs_[o].channels));
    for (size_t i = 0; i < in.size() && w.ok(); ++i) {
      const SlicePlane& o = outputs_[i % outputs_.size()];
      w.over(i, extent()).reads<float>(i, o.plane, {o.channels});
      passOnDropped(in[i], out);
    }
    return w.gives(std::move(out));
  }
  size_t workingBytes() const override {
    size_t channels = 0;
    for (const SlicePlane& o : outputs_) channels += size_t(o.channels);
    return pixels() * channels * sizeof(double);
  }
  int fixedInputs() const override { return 0; }
  int stride() const override { return int(outputs_.size()); }

  struct Sum final : State {
    std::vector<std::vector<double>> values;  // double: of 256 slices too the mean is that of their pictures
    std::shared_ptr<Term> dropped;            // counts alone
  };
  std::unique_ptr<State> begin(const RunContext&, const std::vector<TermPtr>&) const override {
    auto sum = std::make_unique<Sum>();
    for (const SlicePlane& o : outputs_) sum->values.emplace_back(pixels() * size_t(o.channels), 0.0);
    sum->dropped = std::make_shared<Term>("dropped", Domain::Pixel, extent());
    return sum;
  }
  Status step(const RunContext& ctx, State& state, int, const std::vector<TermPtr>& inputs) const override {
    Sum& sum = static_cast<Sum&>(state);
    addDropped(inputs, *sum.dropped);
    for (size_t o = 0; o < outputs_.size(); ++o) {
      const auto picture = inputs[o]->floats(outputs_[o].plane);
      std::vector<double>& values = sum.values[o];
      const bool complete = ctx.arena->parallelFor(
          values.size(), 1 << 15,
          [&](size_t b, size_t e) {
            for (size_t i = b; i < e; ++i) values[i] += double(picture[i]);
          },
          ctx.stop);
      if (!complete) return Status(Code::Cancelled, "stopped");
    }
    return {};
  }
  Result<TermPtr> finish(const RunContext& ctx, std::unique_ptr<State> state) const override {
    const Sum& sum = static_cast<Sum&>(*state);
    for (size_t o = 0; o < outputs_.size(); ++o) {
      const auto out = ctx.result->writable<float>(slicedPlane(o));
      const double share = outputs_[o].mean ? 1.0 / slices_ : 1.0;
      const bool complete = ctx.arena->parallelFor(
          out.size(), 1 << 15,
          [&](size_t b, size_t e) {
            for (size_t i = b; i < e; ++i) out[i] = float(sum.values[o][i] * share);
          },
          ctx.stop);
      if (!complete) return Status(Code::Cancelled, "stopped");
    }
    passOnDropped(*sum.dropped, *ctx.result);
    return TermPtr(ctx.result);
  }

 private:
  Extent extent() const { return {width_, height_, 1}; }
  size_t pixels() const { return size_t(width_) * size_t(height_); }
  void addDropped(const std::vector<TermPtr>& inputs, Term& sum) const {
    std::vector<uint32_t> most;
    for (const TermPtr& input : inputs) {
      const std::span<const uint32_t> counts = droppedPlane(*input);
      if (!counts.empty()) most.resize(counts.size(), 0);
      for (size_t i = 0; i < counts.size(); ++i) most[i] = std::max(most[i], counts[i]);
    }
    DroppedSamples out(sum);
    for (size_t i = 0; i < most.size(); ++i) out.add(i, most[i]);
  }

  std::vector<SlicePlane> outputs_;
  int width_, height_, slices_;
};

}  // namespace

std::string slicedPlane(size_t i) { return "output" + std::to_string(i); }

NodePtr makeSliceSumNode(std::vector<SlicePlane> outputs, int width, int height, int slices) {
  return std::make_shared<SliceSumNode>(std::move(outputs), width, height, slices);
}

}  // namespace gobo

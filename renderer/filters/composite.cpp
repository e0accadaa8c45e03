// SPDX-License-Identifier: Apache-2.0
#include "filters/composite.h"

#include <cmath>

#include "terms/dropped_samples.h"

namespace gobo {
inline namespace filters {

namespace {

Status stopped() { return Status(Code::Cancelled, "stopped"); }

class PixelNode : public Node {
 public:
  PixelNode(int width, int height) : width_(width), height_(height) {}
  size_t pixels() const { return size_t(width_) * height_; }
  Extent pixelExtent() const { return {width_, height_, 1}; }
  Extent viewExtent(int samples) const { return {width_, height_, samples}; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.linearPerGroup = true;
    t.tileable = true;
    return t;
  }

 protected:
  int width_, height_;
};

class CompositeNode final : public PixelNode {
 public:
  CompositeNode(Expression e, int w, int h) : PixelNode(w, h), expression_(std::move(e)) {}
  std::string type() const override { return "composite"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    h.add(width_).add(height_);
    expression_.hash(h);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 0, SIZE_MAX);
    w.require(expression_.check(in));
    for (size_t i = 0; i < in.size(); ++i) w.over(i, pixelExtent());  // those too that only say how many samples they lost
    TermShape out{"picture", Domain::Pixel, pixelExtent(), {unsetPlane<float>("rgb", 3)}};
    for (const TermShape& input : in) passOnDropped(input, out);
    return w.gives(std::move(out));
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto& out = ctx.result;
    auto rgb = out->writable<float>("rgb");
    const bool complete = ctx.arena->parallelFor(
        pixels(), 1 << 15, [&](size_t b, size_t e) { expression_.evaluate(ctx.inputs, b, e, rgb.data() + 3 * b); }, ctx.stop);
    if (!complete) return stopped();
    for (const TermPtr& input : ctx.inputs) passOnDropped(*input, *out);
    return TermPtr(out);
  }

 private:
  Expression expression_;
};

class ShadeNode final : public PixelNode {
 public:
  ShadeNode(int w, int h, int s) : PixelNode(w, h), samples_(s) {}
  std::string type() const override { return "shade"; }
  void hashParameters(Hasher& h) const override { h.add(width_).add(height_).add(samples_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    w.over(0, viewExtent(samples_)).reads<float>(0, "L", {3}).over(1, viewExtent(samples_)).reads<float>(1, "V", {1, 3});
    TermShape out{"direct_light", Domain::Pixel, pixelExtent(), {unsetPlane<float>("rgb", 3)}};
    passOnDropped(w.input(0), out);
    return w.gives(std::move(out));
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto light = ctx.inputs[0]->floats("L");
    const auto v = ctx.inputs[1]->floats("V");
    const size_t C = size_t(ctx.inputs[1]->channels("V")), step = C == 3 ? 1 : 0;  // RGB visibility, or one for all channels
    const auto& out = ctx.result;
    auto rgb = out->writable<float>("rgb");
    const float scale = 1.0f / float(samples_);
    passOnDropped(*ctx.inputs[0], *out);
    const bool complete = ctx.arena->parallelFor(
        pixels(), 1 << 14,
        [&](size_t b, size_t e) {
          for (int s = 0; s < samples_; ++s) {
            const size_t layer = size_t(s) * pixels();
            for (size_t p = b; p < e; ++p) {
              const float *w = v.data() + C * (layer + p), *l = light.data() + 3 * (layer + p);
              for (size_t c = 0; c < 3; ++c) rgb[3 * p + c] = (s ? rgb[3 * p + c] : 0.0f) + w[step * c] * scale * l[c];
            }
          }
        },
        ctx.stop);
    return complete ? Result<TermPtr>(TermPtr(out)) : stopped();
  }

 private:
  int samples_;
};

class DirectFoldNode final : public FoldNode {
 public:
  DirectFoldNode(int w, int h, int s, int lights) : width_(w), height_(h), samples_(s), lights_(lights) {}
  std::string type() const override { return "direct_fold"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.linearPerGroup = true;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(width_).add(height_).add(samples_).add(lights_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, size_t(lights_) * 2);
    const Extent view{width_, height_, samples_};
    TermShape out{"direct_light", Domain::Pixel, {width_, height_, 1}, {unsetPlane<float>("rgb", 3)}};
    for (size_t i = 0; i + 1 < in.size(); i += 2) {
      w.over(i, view).reads<float>(i, "L", {3}).over(i + 1, view).reads<float>(i + 1, "V", {1, 3});
      passOnDropped(in[i], out);
    }
    return w.gives(std::move(out));
  }
  int fixedInputs() const override { return 0; }
  int stride() const override { return 2; }

  struct Sum final : State {
    std::vector<double> rgb;        // double: 1000 lights are summed
    std::shared_ptr<Term> dropped;  // counts alone
  };
  std::unique_ptr<State> begin(const RunContext&, const std::vector<TermPtr>&) const override {
    auto sum = std::make_unique<Sum>();
    sum->rgb.assign(size_t(width_) * height_ * 3, 0.0);
    sum->dropped = std::make_shared<Term>("dropped", Domain::Pixel, Extent{width_, height_, 1});
    return sum;
  }
  Status step(const RunContext& ctx, State& state, int, const std::vector<TermPtr>& inputs) const override {
    auto& rgb = static_cast<Sum&>(state).rgb;
    passOnDropped(*inputs[0], *static_cast<Sum&>(state).dropped);
    const auto light = inputs[0]->floats("L");
    const auto v = inputs[1]->floats("V");
    const size_t C = size_t(inputs[1]->channels("V")), step = C == 3 ? 1 : 0;
    const size_t pixels = size_t(width_) * height_;
    const double scale = 1.0 / samples_;
    const bool complete = ctx.arena->parallelFor(
        pixels, 1 << 14,
        [&](size_t b, size_t e) {
          for (int s = 0; s < samples_; ++s)
            for (size_t p = b; p < e; ++p) {
              const size_t at = size_t(s) * pixels + p;
              for (size_t c = 0; c < 3; ++c) rgb[3 * p + c] += scale * v[C * at + step * c] * light[3 * at + c];
            }
        },
        ctx.stop);
    return complete ? Status() : stopped();
  }
  Result<TermPtr> finish(const RunContext& ctx, std::unique_ptr<State> state) const override {
    const auto& sum = static_cast<Sum&>(*state).rgb;
    const auto& out = ctx.result;
    auto rgb = out->writable<float>("rgb");
    const bool complete = ctx.arena->parallelFor(
        sum.size(), 1 << 15,
        [&](size_t b, size_t e) {
          for (size_t i = b; i < e; ++i) rgb[i] = float(sum[i]);
        },
        ctx.stop);
    if (!complete) return stopped();
    passOnDropped(*static_cast<Sum&>(*state).dropped, *out);
    return TermPtr(out);
  }

 private:
  int width_, height_, samples_, lights_;
};

class ResolveNode final : public PixelNode {
 public:
  ResolveNode(int w, int h, int slots) : PixelNode(w, h), slots_(slots) {}
  std::string type() const override { return "resolve"; }
  void hashParameters(Hasher& h) const override { h.add(width_).add(height_).add(slots_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    w.over(0, pixelExtent()).reads<double>(0, "sum", {3 * slots_}).reads<uint32_t>(0, "samples");
    TermShape out{"radiance", Domain::Pixel, pixelExtent(), {}};
    for (int s = 0; s < slots_; ++s) out.planes.push_back(unsetPlane<float>("s" + std::to_string(s), 3));
    passOnDropped(w.input(0), out);
    return w.gives(std::move(out));
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto sum = ctx.inputs[0]->plane<double>("sum");
    const auto samples = ctx.inputs[0]->plane<uint32_t>("samples");
    const auto& out = ctx.result;
    std::vector<std::span<float>> planes;
    for (int s = 0; s < slots_; ++s) planes.push_back(out->writable<float>("s" + std::to_string(s)));
    // Slot by slot: the first touch of each plane's next huge page has the system clear it, which takes as long as thousands of pixels.
    const bool complete = ctx.arena->parallelFor(
        pixels(), 1 << 11,
        [&](size_t b, size_t e) {
          for (int s = 0; s < slots_; ++s) {
            if (ctx.stop.stopRequested()) return;
            for (size_t p = b; p < e; ++p) {
              const double scale = samples[p] ? 1.0 / samples[p] : 0.0;
              const double* v = sum.data() + (p * slots_ + s) * 3;
              for (int c = 0; c < 3; ++c) planes[s][3 * p + c] = float(v[c] * scale);
            }
          }
        },
        ctx.stop);
    if (!complete || ctx.stop.stopRequested()) return stopped();
    passOnDropped(*ctx.inputs[0], *out);
    return TermPtr(out);
  }

 private:
  int slots_;
};

class PixelMeanNode final : public PixelNode {
 public:
  PixelMeanNode(std::string plane, int channels, int w, int h, int s, bool overValidOnly)
      : PixelNode(w, h), plane_(std::move(plane)), channels_(channels), samples_(s), overValidOnly_(overValidOnly) {}
  std::string type() const override { return "pixel_mean"; }
  void hashParameters(Hasher& h) const override { h.add(plane_).add(channels_).add(width_).add(height_).add(samples_).add(overValidOnly_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1, 2);
    w.over(0, viewExtent(samples_)).reads<float>(0, plane_, {channels_, channels_ == 1 ? 3 : channels_});
    if (in.size() > 1) w.over(1, viewExtent(samples_)).reads<uint32_t>(1, "instance");
    return w.gives({"pixels", Domain::Pixel, pixelExtent(), {unsetPlane<float>(plane_, channels_)}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto in = ctx.inputs[0]->floats(plane_);
    const bool grey = channels_ == 1 && ctx.inputs[0]->channels(plane_) == 3;  // RGB visibility shown as one channel: its luminance
    const bool masked = ctx.inputs.size() > 1;
    const std::span<const uint32_t> valid = masked ? ctx.inputs[1]->plane<uint32_t>("instance") : std::span<const uint32_t>{};
    const auto& out = ctx.result;
    auto mean = out->writable<float>(plane_);
    const bool complete = ctx.arena->parallelFor(
        pixels(), 1 << 13,
        [&](size_t b, size_t e) {
          for (size_t p = b; p < e; ++p) {
            double sum[4] = {0, 0, 0, 0};
            int count = 0;
            for (int s = 0; s < samples_; ++s) {
              const size_t at = size_t(s) * pixels() + p;
              if (masked && valid[at] == ~0u) continue;
              ++count;
              if (grey) sum[0] += luminance(Vec3(in[at * 3], in[at * 3 + 1], in[at * 3 + 2]));
              else
                for (int c = 0; c < channels_; ++c) sum[c] += in[at * channels_ + c];
            }
            const double n = overValidOnly_ ? count : samples_;
            for (int c = 0; c < channels_; ++c) mean[p * channels_ + c] = n > 0 ? float(sum[c] / n) : 0.0f;
          }
        },
        ctx.stop);
    return complete ? Result<TermPtr>(TermPtr(out)) : stopped();
  }

 private:
  std::string plane_;
  int channels_, samples_;
  bool overValidOnly_;
};

class AlphaNode final : public PixelNode {
 public:
  AlphaNode(int w, int h, int s) : PixelNode(w, h), samples_(s) {}
  std::string type() const override { return "alpha"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(width_).add(height_).add(samples_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    w.over(0, viewExtent(samples_)).reads<uint32_t>(0, "instance");
    return w.gives({"pixels", Domain::Pixel, pixelExtent(), {unsetPlane<float>("alpha")}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto instance = ctx.inputs[0]->plane<uint32_t>("instance");
    const auto& out = ctx.result;
    auto alpha = out->writable<float>("alpha");
    const bool complete = ctx.arena->parallelFor(
        pixels(), 1 << 15,
        [&](size_t b, size_t e) {
          for (size_t p = b; p < e; ++p) {
            int hits = 0;
            for (int s = 0; s < samples_; ++s) hits += instance[size_t(s) * pixels() + p] != ~0u;
            alpha[p] = float(hits) / float(samples_);
          }
        },
        ctx.stop);
    return complete ? Result<TermPtr>(TermPtr(out)) : stopped();
  }

 private:
  int samples_;
};

}  // namespace

NodePtr makeCompositeNode(Expression e, int w, int h) { return std::make_shared<CompositeNode>(std::move(e), w, h); }
NodePtr makeShadeNode(int w, int h, int s) { return std::make_shared<ShadeNode>(w, h, s); }
NodePtr makeDirectFoldNode(int w, int h, int s, int lights) { return std::make_shared<DirectFoldNode>(w, h, s, lights); }
NodePtr makeResolveNode(int w, int h, int slots) { return std::make_shared<ResolveNode>(w, h, slots); }
NodePtr makePixelMeanNode(std::string plane, int channels, int w, int h, int s, bool overValidOnly) {
  return std::make_shared<PixelMeanNode>(std::move(plane), channels, w, h, s, overValidOnly);
}
NodePtr makeAlphaNode(int w, int h, int s) { return std::make_shared<AlphaNode>(w, h, s); }

}  // namespace filters
}  // namespace gobo

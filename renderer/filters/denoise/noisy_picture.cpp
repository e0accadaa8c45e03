// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/noisy_picture.h"

#include <algorithm>
#include <cmath>

#include "filters/denoise/similar_rows.h"
#include "terms/scratch.h"

namespace gobo::denoise {

namespace {

constexpr float kMost = 1e18f;  // of a demodulated value: squares of it are finite

class NoisyPictureNode final : public Node {
 public:
  NoisyPictureNode(int width, int height, uint32_t samples, uint32_t first, bool curvature)
      : width_(width), height_(height), samples_(samples), first_(first), curvature_(curvature) {}
  std::string type() const override { return "noisy_picture"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    t.halo = kVarianceRadius;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(width_).add(height_).add(samples_).add(first_).add(curvature_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    const Extent all{width_, height_, 1};
    Wiring w(type(), in, pictures() + (curvature_ ? 2 : 1));
    w.require(samples_ == 1 || (first_ > 0 && first_ < samples_), "two halves");
    readFeatures(w, 0, all);
    for (size_t i = 1; i <= pictures(); ++i) w.over(i, all).reads<float>(i, "rgb", {3});
    w.reads<float>(0, "modulation", {3});
    TermShape out{
        type(), Domain::Pixel, all, {unsetPlane<float>("mean", 3), unsetPlane<float>("a", 3), unsetPlane<float>("b", 3), unsetPlane<float>("variance", 3)}};
    if (curvature_) {
      w.over(pictures() + 1, all).reads<float>(pictures() + 1, "rgb", {3});
      out.planes.push_back(unsetPlane<float>("curvature"));
    }
    return w.gives(std::move(out));
  }
  size_t workingBytes() const override { return AlikeFeatures::bytes(width_, height_) + 12 * sizeof(float) * size_t(width_) * size_t(height_); }
  Cost cost(const TermShape& result, uint32_t) const override { return {0.0, 150.0 * double(result.extent.elements())}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto& out = ctx.result;
    const Features f = featuresOf(*ctx.inputs[0]);
    const auto modulation = ctx.inputs[0]->floats("modulation");
    const auto whole = ctx.inputs[pictures()]->floats("rgb"), part = ctx.inputs[1]->floats("rgb");
    const auto mean = out->writable<float>("mean"), a = out->writable<float>("a"), b = out->writable<float>("b");
    const auto variance = out->writable<float>("variance");
    const double n = samples_, m = first_;
    bool complete = ctx.arena->parallelFor(
        size_t(width_) * size_t(height_), 1 << 12,
        [&](size_t begin, size_t end) {
          for (size_t p = begin; p < end; ++p)
            for (size_t c = 0; c < 3; ++c) {
              const size_t i = 3 * p + c;
              const double scale = 1.0 / double(modulation[i]), all = whole[i], some = part[i];
              const auto bounded = [](double v) { return float(std::clamp(v, -double(kMost), double(kMost))); };
              mean[i] = bounded(all * scale);
              a[i] = bounded(some * scale);
              b[i] = samples_ > 1 ? bounded((n * all - m * some) / (n - m) * scale) : a[i];
            }
        },
        ctx.stop);
    complete = complete && demodulateCurvature(modulation, ctx) && smoothVariance(f, mean, a, b, variance, ctx);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(out);
  }

 private:
  size_t pictures() const { return samples_ > 1 ? 2 : 1; }

  /// False: stopped.
  bool demodulateCurvature(std::span<const float> modulation, const RunContext& ctx) const {
    if (!curvature_) return true;
    const auto rgb = ctx.inputs[pictures() + 1]->floats("rgb");
    const auto curvature = ctx.result->writable<float>("curvature");
    return ctx.arena->parallelFor(
        curvature.size(), 1 << 13,
        [&](size_t begin, size_t end) {
          for (size_t p = begin; p < end; ++p) {
            double sum = 0;
            for (size_t c = 0; c < 3; ++c) sum += double(rgb[3 * p + c]) / double(modulation[3 * p + c]);
            curvature[p] = float(std::clamp(sum / 3, 0.0, 1e30));
          }
        },
        ctx.stop);
  }

  /// False: stopped.
  bool smoothVariance(const Features& f, std::span<const float> mean, std::span<const float> a, std::span<const float> b, std::span<float> variance,
                      const RunContext& ctx) const {
    AlikeFeatures alike;
    if (!alike.fill(f, width_, height_, *ctx.arena, ctx.stop)) return false;
    const size_t pixels = size_t(width_) * size_t(height_);
    const int channels = samples_ > 1 ? 3 : 6;  // squares of differences; or values and their squares
    const Scratch<float> planes(2 * size_t(channels) * pixels);
    float *in[6], *out[6];
    for (int c = 0; c < channels; ++c) {
      in[c] = planes.get() + size_t(c) * pixels;
      out[c] = planes.get() + size_t(channels + c) * pixels;
    }
    const double n = samples_, m = first_;
    const float share = samples_ > 1 ? float(m * (n - m) / (n * n)) : 1.0f;
    if (!ctx.arena->parallelFor(
            pixels, 1 << 13,
            [&](size_t begin, size_t end) {
              for (size_t p = begin; p < end; ++p)
                for (int c = 0; c < channels; ++c) {
                  const size_t i = 3 * p + size_t(c % 3);
                  const float d = a[i] - b[i];
                  in[c][p] = samples_ > 1 ? d * d : c < 3 ? mean[i] : mean[i] * mean[i];
                }
            },
            ctx.stop))
      return false;
    const float spatial[kVarianceRadius + 1] = {1, 1, 1, 1};
    return ctx.arena->parallelFor(
        size_t(height_), 2,
        [&](size_t begin, size_t end) {
          for (size_t y = begin; y < end; ++y) {
            alikeMeansRow(alike.planes(), kLoosely, spatial, kVarianceRadius, in, channels, int(y), out);
            for (size_t p = y * size_t(width_); p < (y + 1) * size_t(width_); ++p)
              for (size_t c = 0; c < 3; ++c) {
                const double value = samples_ > 1 ? double(share) * out[c][p] : double(out[3 + c][p]) - double(out[c][p]) * out[c][p];
                variance[3 * p + c] = float(std::clamp(value, 0.0, 3e38));
              }
          }
        },
        ctx.stop);
  }

  int width_, height_;
  uint32_t samples_, first_;
  bool curvature_;
};

}  // namespace

NodePtr makeNoisyPictureNode(int width, int height, uint32_t samples, uint32_t first, bool curvature) {
  return std::make_shared<NoisyPictureNode>(width, height, samples, first, curvature);
}

NoisyPicture noisyPicture(const Term& features, const Term& noisy, uint32_t samples, uint32_t first) {
  NoisyPicture p;
  p.width = noisy.extent().width;
  p.height = noisy.extent().height;
  p.mean = noisy.floats("mean");
  p.a = noisy.floats("a");
  p.b = noisy.floats("b");
  p.variance = noisy.floats("variance");
  p.halves = samples > 1;
  p.shareOfA = samples > 1 ? float(double(first) / double(samples)) : 1.0f;
  const Features f = featuresOf(features);
  p.albedo = f.albedo;
  p.normal = f.normal;
  p.position = f.position;
  p.depth = f.depth;
  p.footprint = f.footprint;
  p.coverage = f.coverage;
  const auto optional = [](const Term& t, const char* plane) { return t.hasPlane(plane) ? t.floats(plane) : std::span<const float>(); };
  p.even = optional(features, "even");
  p.alpha = optional(features, "alpha");
  p.blur = optional(features, "blur");
  p.curvature = optional(noisy, "curvature");
  return p;
}

}  // namespace gobo::denoise

// SPDX-License-Identifier: Apache-2.0
#include "filters/outliers/nodes.h"

#include <algorithm>
#include <numeric>

#include "filters/outliers/white.h"
#include "filters/path_density/nodes.h"
#include "terms/dropped_samples.h"

namespace gobo::outliers {

namespace {

/// Samples as they lie in a term: pixel by pixel, as many in each, wherever on the film.
SampleBins binsOfPixels(const SampleView& s) {
  SampleBins b;
  b.width = b.cellsX = s.width;
  b.height = b.cellsY = s.height;
  const size_t pixels = size_t(s.width) * size_t(s.height), n = s.size() / pixels;
  b.order.resize(s.size());
  std::iota(b.order.begin(), b.order.end(), 0u);
  b.slotStart.resize(pixels + 1);
  for (size_t p = 0; p <= pixels; ++p) b.slotStart[p] = uint32_t(p * n);
  return b;
}

class EstimatorNode : public Node {
 public:
  EstimatorNode(int width, int height) : width_(width), height_(height) {}
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, inputs());
    const Extent all{width_, height_, 1};
    pathdensity::readPathSamples(w, 0, width_, height_);
    if (inputs() > 1) w.over(1, all).reads<float>(1, "rgb", {3});
    TermShape out{type(), Domain::Pixel, all, {unsetPlane<float>("rgb", 3)}};
    passOnDropped(w.input(0), out);
    return w.gives(std::move(out));
  }
  Cost cost(const TermShape& result, uint32_t) const override {
    return {0.0, 16.0 * 60.0 * double(result.extent.elements())};  // samples are not known here: 16 a pixel
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const SampleView samples = pathdensity::pathSamplesOf(*ctx.inputs[0]);
    const SampleBins bins = binsOfPixels(samples);
    GOBO_ASSIGN(const std::vector<float> rgb, estimate(samples, bins, ctx));
    if (ctx.stop.stopRequested()) return Status(Code::Cancelled, "stopped");
    std::copy(rgb.begin(), rgb.end(), ctx.result->writable<float>("rgb").begin());
    passOnDropped(*ctx.inputs[0], *ctx.result);
    return TermPtr(ctx.result);
  }

 protected:
  virtual size_t inputs() const { return 1; }
  virtual Result<std::vector<float>> estimate(const SampleView& samples, const SampleBins& bins, const RunContext& ctx) const = 0;
  static NodeTraits within(int halo) {
    NodeTraits t;
    t.tileable = true;
    t.halo = halo;
    return t;
  }
  int width_, height_;
};

class TrimmedMeanNode final : public EstimatorNode {
 public:
  TrimmedMeanNode(double share, int width, int height) : EstimatorNode(width, height), share_(share) {}
  std::string type() const override { return "trimmed_mean"; }
  NodeTraits traits() const override { return within(0); }
  void hashParameters(Hasher& h) const override { h.add(width_).add(height_).add(share_); }

 private:
  Result<std::vector<float>> estimate(const SampleView& samples, const SampleBins& bins, const RunContext& ctx) const override {
    return trimmedMean(samples, bins, share_, {ctx.arena, ctx.stop});
  }
  double share_;
};

class MedianOfMeansNode final : public EstimatorNode {
 public:
  MedianOfMeansNode(int buckets, int width, int height) : EstimatorNode(width, height), buckets_(buckets) {}
  std::string type() const override { return "median_of_means"; }
  NodeTraits traits() const override { return within(0); }
  void hashParameters(Hasher& h) const override { h.add(width_).add(height_).add(buckets_); }

 private:
  Result<std::vector<float>> estimate(const SampleView& samples, const SampleBins& bins, const RunContext& ctx) const override {
    return adaptiveMedianOfMeans(samples, bins, buckets_, {ctx.arena, ctx.stop});
  }
  int buckets_;
};

class ReweightedMeanNode final : public EstimatorNode {
 public:
  ReweightedMeanNode(const Reweighting& settings, int width, int height) : EstimatorNode(width, height), s_(settings) {}
  std::string type() const override { return "reweighted_mean"; }
  NodeTraits traits() const override { return s_.start > 0 ? within(1) : NodeTraits{}; }
  void hashParameters(Hasher& h) const override { h.add(width_).add(height_).add(s_.start).add(s_.base).add(s_.enough); }

 private:
  size_t inputs() const override { return s_.start > 0 ? 1 : 2; }
  Result<std::vector<float>> estimate(const SampleView& samples, const SampleBins& bins, const RunContext& ctx) const override {
    Reweighting own = s_;
    if (inputs() > 1) { GOBO_ASSIGN(own.start, whiteOfSamples(samples, ctx.inputs[1]->floats("rgb"), *ctx.arena, ctx.stop)); }
    return reweightedMean(samples, bins, own, {ctx.arena, ctx.stop});
  }
  Reweighting s_;
};

}  // namespace

NodePtr makeTrimmedMeanNode(double share, int width, int height) { return std::make_shared<TrimmedMeanNode>(share, width, height); }
NodePtr makeMedianOfMeansNode(int buckets, int width, int height) { return std::make_shared<MedianOfMeansNode>(buckets, width, height); }
NodePtr makeReweightedMeanNode(const Reweighting& settings, int width, int height) { return std::make_shared<ReweightedMeanNode>(settings, width, height); }

Result<float> whiteOfSamples(const SampleView& s, std::span<const float> rest, const TaskArena& arena, const StopToken& stop) {
  const size_t n = s.size() / (size_t(s.width) * size_t(s.height));
  std::vector<float> picture(rest.begin(), rest.end());
  const bool complete = arena.parallelFor(
      picture.size() / 3, 1 << 12,
      [&](size_t begin, size_t end) {
        for (size_t p = begin; p < end; ++p)
          for (size_t c = 0; c < 3; ++c) {
            double sum = 0;
            for (size_t i = p * n; i < (p + 1) * n; ++i) sum += double(s.indirect[3 * i + c]);
            picture[3 * p + c] = float(std::clamp(double(picture[3 * p + c]) + sum / double(n), -3.4e38, 3.4e38));
          }
      },
      stop);
  if (!complete) return Status(Code::Cancelled, "stopped");
  return whiteOf(picture, s.width, s.height, arena, stop);
}

}  // namespace gobo::outliers

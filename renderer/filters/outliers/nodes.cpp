// SPDX-License-Identifier: Apache-2.0
#include "filters/outliers/nodes.h"

#include <algorithm>

#include "filters/outliers/white.h"
#include "filters/path_density/nodes.h"
#include "terms/dropped_samples.h"

namespace gobo::outliers {

namespace {

/// Samples as they lie in a term: pixel by pixel, as many in each, wherever on the film. The first `most` of each.
SampleBins binsOfPixels(const SampleView& s, size_t most) {
  SampleBins b;
  b.width = b.cellsX = s.width;
  b.height = b.cellsY = s.height;
  const size_t pixels = size_t(s.width) * size_t(s.height), n = s.size() / pixels, taken = std::min(n, most);
  b.order.reserve(pixels * taken);
  b.slotStart.reserve(pixels + 1);
  for (size_t p = 0; p < pixels; ++p) {
    b.slotStart.push_back(uint32_t(b.order.size()));
    for (size_t i = 0; i < taken; ++i) b.order.push_back(uint32_t(p * n + i));
  }
  b.slotStart.push_back(uint32_t(b.order.size()));
  return b;
}

class EstimatorNode : public Node {
 public:
  EstimatorNode(int width, int height, int first) : width_(width), height_(height), first_(first) {}
  void hashParameters(Hasher& h) const override { hashSettings(h.add(width_).add(height_).add(first_)); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, inputs());
    const Extent all{width_, height_, 1};
    pathdensity::readPathSamples(w, 0, width_, height_);
    if (inputs() > 1) w.over(1, all).reads<float>(1, "rgb", {3});
    TermShape out{type(), Domain::Pixel, all, {unsetPlane<float>("rgb", 3)}};
    if (first_ > 0) out.planes.push_back(unsetPlane<float>("first", 3));
    passOnDropped(w.input(0), out);
    return w.gives(std::move(out));
  }
  Cost cost(const TermShape& result, uint32_t) const override {
    return {0.0, 16.0 * 60.0 * double(result.extent.elements())};  // samples are not known here: 16 a pixel
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const SampleView samples = pathdensity::pathSamplesOf(*ctx.inputs[0]);
    const SampleBins bins = binsOfPixels(samples, samples.size());
    GOBO_ASSIGN(const float white, whiteFor(samples, ctx));
    const Rows rows{ctx.arena, ctx.stop};
    const auto fill = [&](const char* name, const std::vector<float>& rgb) { std::copy(rgb.begin(), rgb.end(), ctx.result->writable<float>(name).begin()); };
    fill("rgb", estimate(samples, bins, bins, white, rows));
    if (first_ > 0) fill("first", estimate(samples, bins, binsOfPixels(samples, size_t(first_)), white, rows));
    if (ctx.stop.stopRequested()) return Status(Code::Cancelled, "stopped");
    passOnDropped(*ctx.inputs[0], *ctx.result);
    return TermPtr(ctx.result);
  }

 protected:
  virtual void hashSettings(Hasher& h) const = 0;
  virtual size_t inputs() const { return 1; }
  virtual std::vector<float> estimate(const SampleView& samples, const SampleBins& all, const SampleBins& part, float white, const Rows& rows) const = 0;
  static NodeTraits within(int halo) {
    NodeTraits t;
    t.tileable = true;
    t.halo = halo;
    return t;
  }

 private:
  Result<float> whiteFor(const SampleView& samples, const RunContext& ctx) const {
    if (inputs() < 2) return 0.0f;
    return whiteOfSamples(samples, ctx.inputs[1]->floats("rgb"), *ctx.arena, ctx.stop);
  }
  int width_, height_, first_;
};

class TrimmedMeanNode final : public EstimatorNode {
 public:
  TrimmedMeanNode(double share, int width, int height, int first) : EstimatorNode(width, height, first), share_(share) {}
  std::string type() const override { return "trimmed_mean"; }
  NodeTraits traits() const override { return within(0); }

 private:
  void hashSettings(Hasher& h) const override { h.add(share_); }
  std::vector<float> estimate(const SampleView& samples, const SampleBins&, const SampleBins& part, float, const Rows& rows) const override {
    return trimmedMean(samples, part, share_, rows);
  }
  double share_;
};

class MedianOfMeansNode final : public EstimatorNode {
 public:
  MedianOfMeansNode(int buckets, int width, int height, int first) : EstimatorNode(width, height, first), buckets_(buckets) {}
  std::string type() const override { return "median_of_means"; }
  NodeTraits traits() const override { return within(0); }

 private:
  void hashSettings(Hasher& h) const override { h.add(buckets_); }
  std::vector<float> estimate(const SampleView& samples, const SampleBins&, const SampleBins& part, float, const Rows& rows) const override {
    return adaptiveMedianOfMeans(samples, part, buckets_, rows);
  }
  int buckets_;
};

class ReweightedMeanNode final : public EstimatorNode {
 public:
  ReweightedMeanNode(const Reweighting& settings, int width, int height, int first) : EstimatorNode(width, height, first), s_(settings) {}
  std::string type() const override { return "reweighted_mean"; }
  int version() const override { return 2; }
  NodeTraits traits() const override { return s_.start > 0 ? within(1) : NodeTraits{}; }

 private:
  void hashSettings(Hasher& h) const override { h.add(s_.start).add(s_.base).add(s_.enough); }
  size_t inputs() const override { return s_.start > 0 ? 1 : 2; }
  std::vector<float> estimate(const SampleView& samples, const SampleBins& all, const SampleBins& part, float white, const Rows& rows) const override {
    Reweighting own = s_;
    if (inputs() > 1) own.start = white;
    return &all == &part ? reweightedMean(samples, all, own, rows) : reweightedPart(samples, all, part, own, rows);
  }
  Reweighting s_;
};

}  // namespace

NodePtr makeTrimmedMeanNode(double share, int width, int height, int first) { return std::make_shared<TrimmedMeanNode>(share, width, height, first); }
NodePtr makeMedianOfMeansNode(int buckets, int width, int height, int first) { return std::make_shared<MedianOfMeansNode>(buckets, width, height, first); }
NodePtr makeReweightedMeanNode(const Reweighting& settings, int width, int height, int first) {
  return std::make_shared<ReweightedMeanNode>(settings, width, height, first);
}

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

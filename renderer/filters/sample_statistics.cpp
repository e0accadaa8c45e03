// SPDX-License-Identifier: Apache-2.0
#include "filters/sample_statistics.h"

#include <algorithm>

#include "trace/sample_passes.h"

namespace gobo {
inline namespace filters {

namespace {

class SampleCountNode final : public Node {
 public:
  SampleCountNode(int width, int height) : width_(width), height_(height) {}
  std::string type() const override { return "pixel_sample_count"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(width_).add(height_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 0, SIZE_MAX);
    for (size_t i = 0; i < in.size(); ++i) w.over(i, {width_, height_, 1}).reads<uint32_t>(i, "samples");
    return w.gives({"pixels", Domain::Pixel, {width_, height_, 1}, {plane<float>("count")}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto& out = ctx.result;
    const auto count = out->writable<float>("count");
    for (size_t i = 0; i < ctx.inputs.size(); ++i) {
      const auto samples = ctx.inputs[i]->plane<uint32_t>("samples");
      const bool complete = ctx.arena->parallelFor(
          count.size(), 1 << 15,
          [&](size_t begin, size_t end) {
            for (size_t p = begin; p < end; ++p) count[p] = i == 0 ? float(samples[p]) : std::min(count[p], float(samples[p]));
          },
          ctx.stop);
      if (!complete) return Status(Code::Cancelled, "stopped");
    }
    return TermPtr(out);
  }

 private:
  int width_, height_;
};

class VarianceNode final : public Node {
 public:
  VarianceNode(std::vector<VarianceWeight> weights, int inputs, int width, int height, int streams)
      : weights_(std::move(weights)), inputs_(inputs), width_(width), height_(height), streams_(streams) {}
  std::string type() const override { return "pixel_variance"; }
  int version() const override { return 2; }  // 2: the first block may be a part of one
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    h.add(width_).add(height_).add(streams_).add(uint64_t(weights_.size()));
    for (const VarianceWeight& w : weights_) h.add(w.input).add(w.slot).add(w.weight.x).add(w.weight.y).add(w.weight.z);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, size_t(inputs_));
    const auto one = [&](size_t i) { return 3 * streams_ * std::max(w.channels(i, "streams") / (3 * streams_), 1); };  // slots
    for (size_t i = 0; i < in.size() && !weights_.empty(); ++i)
      w.over(i, {width_, height_, 1}).reads<uint32_t>(i, "samples").reads<float>(i, "streams", {one(i)});
    for (const VarianceWeight& v : weights_) w.require(3 * streams_ * (v.slot + 1) <= w.channels(size_t(v.input), "streams"), "the slots that it weighs");
    return w.gives({"pixels", Domain::Pixel, {width_, height_, 1}, {plane<float>("variance", 3)}});
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto& out = ctx.result;
    const auto variance = out->writable<float>("variance");
    if (weights_.empty()) return TermPtr(out);  // nothing is path traced: nothing scatters
    std::vector<std::span<const float>> parts;
    std::vector<std::span<const uint32_t>> samples;
    std::vector<size_t> slots;
    for (const TermPtr& t : ctx.inputs) {
      parts.push_back(t->floats("streams"));
      samples.push_back(t->plane<uint32_t>("samples"));
      slots.push_back(size_t(t->channels("streams")) / 3 / size_t(streams_));
    }
    const bool complete = ctx.arena->parallelFor(
        variance.size() / 3, 1 << 11,
        [&](size_t begin, size_t end) {
          std::vector<DVec3> mean(streams_);
          std::vector<double> n(streams_);
          for (size_t p = begin; p < end; ++p) {
            int used = 0;
            double total = 0;
            DVec3 all(0.0);
            for (int k = 0; k < streams_; ++k) {
              mean[k] = DVec3(0.0);
              n[k] = double(samplesOfStream(samples[0][p], uint32_t(k), uint32_t(streams_)));
              if (n[k] == 0) continue;
              for (const VarianceWeight& w : weights_) {
                const double count = double(samplesOfStream(samples[w.input][p], uint32_t(k), uint32_t(streams_)));
                const float* s = parts[w.input].data() + ((p * streams_ + k) * slots[w.input] + w.slot) * 3;
                if (count > 0) mean[k] += DVec3(w.weight) * DVec3(s[0], s[1], s[2]) / count;
              }
              ++used;
              total += n[k];
              all += n[k] * mean[k];
            }
            DVec3 spread(0.0);
            for (int k = 0; k < streams_; ++k)
              if (n[k] > 0) spread += n[k] * (mean[k] - all / total) * (mean[k] - all / total);
            for (int c = 0; c < 3; ++c) {
              const double v = used > 1 ? spread[c] / ((used - 1) * total) : -1.0;
              variance[3 * p + c] = float(std::min(v, 3.0e38));
            }
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(out);
  }

 private:
  std::vector<VarianceWeight> weights_;
  int inputs_, width_, height_, streams_;
};

}  // namespace

NodePtr makeSampleCountNode(int width, int height) { return std::make_shared<SampleCountNode>(width, height); }
NodePtr makeVarianceNode(std::vector<VarianceWeight> weights, int inputs, int width, int height, int streams) {
  return std::make_shared<VarianceNode>(std::move(weights), inputs, width, height, streams);
}

}  // namespace filters
}  // namespace gobo

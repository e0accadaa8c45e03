// SPDX-License-Identifier: Apache-2.0
#include "filters/slice_sum.h"

#include <algorithm>
#include <limits>

#include "filters/rank_sums.h"
#include "terms/dropped_samples.h"

namespace gobo {
inline namespace filters {

namespace {

using How = SlicePlane::How;

class SliceSumNode final : public FoldNode {
 public:
  SliceSumNode(std::vector<SlicePlane> outputs, int w, int h, int slices) : outputs_(std::move(outputs)), width_(w), height_(h), slices_(slices) {}
  std::string type() const override { return "slice_sum"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.linearPerGroup = std::all_of(outputs_.begin(), outputs_.end(), [](const SlicePlane& o) { return o.how == How::Sum || o.how == How::Mean; });
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    h.add(width_).add(height_).add(slices_);
    for (const SlicePlane& o : outputs_) h.add(o.plane).add(o.channels).add(int(o.how)).add(o.with);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, outputs_.size() * size_t(slices_));
    TermShape out{"picture", Domain::Pixel, extent(), {}};
    for (const SlicePlane& o : outputs_) w.require(rightly(o), "another plane beside " + o.plane);
    for (size_t o = 0; o < outputs_.size(); ++o) out.planes.push_back(unsetPlane<float>(slicedPlane(o), outputs_[o].channels));
    for (size_t i = 0; i < in.size() && w.ok(); ++i) {
      const SlicePlane& o = outputs_[i % outputs_.size()];
      w.over(i, extent()).reads<float>(i, o.plane, {o.channels});
      passOnDropped(in[i], out);
    }
    return w.gives(std::move(out));
  }
  size_t workingBytes() const override {
    size_t bytes = 0;
    for (const SlicePlane& o : outputs_) bytes += o.how == How::Ranked ? RankSums::kBytesAPixel : size_t(o.channels) * sizeof(double);
    return pixels() * bytes;
  }
  int fixedInputs() const override { return 0; }
  int stride() const override { return int(outputs_.size()); }

  struct Sum final : State {
    std::vector<std::vector<double>> values;  // double: of 256 slices too the mean is that of their pictures
    std::vector<RankSums> ranks;              // of pixels() elements where the output is Ranked
    std::shared_ptr<Term> dropped;            // counts alone
  };
  std::unique_ptr<State> begin(const RunContext&, const std::vector<TermPtr>&) const override {
    auto sum = std::make_unique<Sum>();
    for (const SlicePlane& o : outputs_) {
      const bool ranked = o.how == How::Ranked;
      sum->values.emplace_back(ranked ? 0 : pixels() * size_t(o.channels), o.how == How::Least ? std::numeric_limits<double>::max() : 0.0);
      sum->ranks.emplace_back(ranked ? pixels() : 0);
    }
    sum->dropped = std::make_shared<Term>("dropped", Domain::Pixel, extent());
    return sum;
  }
  Status step(const RunContext& ctx, State& state, int slice, const std::vector<TermPtr>& inputs) const override {
    Sum& sum = static_cast<Sum&>(state);
    addDropped(inputs, *sum.dropped);
    for (size_t o = 0; o < outputs_.size(); ++o) {
      const SlicePlane& plane = outputs_[o];
      if (plane.how == How::MeanOfEven && slice % 2) continue;
      const auto picture = inputs[o]->floats(plane.plane);
      const auto seen = bySeen(plane) ? inputs[size_t(plane.with)]->floats(outputs_[size_t(plane.with)].plane) : std::span<const float>();
      std::vector<double>& values = sum.values[o];
      const size_t channels = size_t(plane.channels);
      const bool ranked = plane.how == How::Ranked;
      const bool complete = ctx.arena->parallelFor(
          ranked ? pixels() : values.size(), ranked ? 1 << 12 : 1 << 15,
          [&](size_t b, size_t e) {
            if (ranked) {
              for (size_t p = b; p < e; ++p) sum.ranks[o].add(p, picture.subspan(p * channels, channels));
              return;
            }
            for (size_t i = b; i < e; ++i) {
              const double v = picture[i];
              switch (plane.how) {
                case How::Least: values[i] = std::min(values[i], v); break;
                case How::MeanOverSeen: values[i] += double(seen[i / channels]) * v; break;
                case How::MeanOfSeen: values[i] += seen[i / channels] > 0.0f ? v : 0.0; break;
                default: values[i] += v;
              }
            }
          },
          ctx.stop);
      if (!complete) return Status(Code::Cancelled, "stopped");
    }
    return {};
  }
  Result<TermPtr> finish(const RunContext& ctx, std::unique_ptr<State> state) const override {
    Sum& sum = static_cast<Sum&>(*state);
    for (size_t o = 0; o < outputs_.size(); ++o) {
      const SlicePlane& plane = outputs_[o];
      const auto out = ctx.result->writable<float>(slicedPlane(o));
      const int of = plane.how == How::Sum || plane.how == How::Least ? 1 : plane.how == How::MeanOfEven ? (slices_ + 1) / 2 : slices_;
      const double share = 1.0 / of;
      const std::vector<double>* with = plane.with >= 0 ? &sum.values[size_t(plane.with)] : nullptr;
      const size_t channels = size_t(plane.channels);
      const bool ranked = plane.how == How::Ranked;
      const bool complete = ctx.arena->parallelFor(
          ranked ? pixels() : out.size(), ranked ? 1 << 12 : 1 << 15,
          [&](size_t b, size_t e) {
            if (ranked) {
              for (size_t p = b; p < e; ++p) sum.ranks[o].write(p, slices_, out.subspan(p * channels, channels));
              return;
            }
            for (size_t i = b; i < e; ++i) {
              const double v = sum.values[o][i];
              if (!with) out[i] = float(v * share);
              else {
                const double weight = (*with)[i / channels];
                if (plane.how == How::MeanOverSeen) out[i] = weight > 0 ? float(v / weight) : 0.0f;
                else out[i] = weight > 0 ? float(v * share) : 1.0f;
              }
            }
          },
          ctx.stop);
      if (!complete) return Status(Code::Cancelled, "stopped");
    }
    passOnDropped(*sum.dropped, *ctx.result);
    return TermPtr(ctx.result);
  }

 private:
  bool rightly(const SlicePlane& o) const {
    if (!bySeen(o)) return o.with < 0;
    if (o.with < 0 || size_t(o.with) >= outputs_.size()) return false;
    const SlicePlane& with = outputs_[size_t(o.with)];
    return with.how == How::Mean && with.channels == 1;
  }
  static bool bySeen(const SlicePlane& o) { return o.how == How::MeanOverSeen || o.how == How::MeanOfSeen; }
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

class SlicePartNode final : public Node {
 public:
  SlicePartNode(std::string term, std::vector<NamedPlane> planes, size_t first, int w, int h)
      : term_(std::move(term)), planes_(std::move(planes)), first_(first), width_(w), height_(h) {}
  std::string type() const override { return "slice_part"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.linearPerGroup = true;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    h.add(width_).add(height_).add(term_).add(uint64_t(first_));
    for (const NamedPlane& p : planes_) h.add(p.name).add(p.channels);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    const Extent all{width_, height_, 1};
    Wiring w(type(), in, 1);
    w.over(0, all);
    TermShape out{term_, Domain::Pixel, all, {}};
    for (size_t i = 0; i < planes_.size(); ++i) {
      w.reads<float>(0, slicedPlane(first_ + i), {planes_[i].channels});
      out.planes.push_back(unsetPlane<float>(planes_[i].name, planes_[i].channels));
    }
    return w.gives(std::move(out));
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    for (size_t i = 0; i < planes_.size(); ++i) {
      const auto in = ctx.inputs[0]->floats(slicedPlane(first_ + i));
      const auto out = ctx.result->writable<float>(planes_[i].name);
      const bool complete = ctx.arena->parallelFor(
          out.size(), 1 << 16, [&](size_t b, size_t e) { std::copy(in.begin() + ptrdiff_t(b), in.begin() + ptrdiff_t(e), out.begin() + ptrdiff_t(b)); },
          ctx.stop);
      if (!complete) return Status(Code::Cancelled, "stopped");
    }
    return TermPtr(ctx.result);
  }

 private:
  std::string term_;
  std::vector<NamedPlane> planes_;
  size_t first_;
  int width_, height_;
};

}  // namespace

std::string slicedPlane(size_t i) { return "output" + std::to_string(i); }

NodePtr makeSliceSumNode(std::vector<SlicePlane> outputs, int width, int height, int slices) {
  return std::make_shared<SliceSumNode>(std::move(outputs), width, height, slices);
}

NodePtr makeSlicePartNode(std::string term, std::vector<NamedPlane> planes, size_t first, int width, int height) {
  return std::make_shared<SlicePartNode>(std::move(term), std::move(planes), first, width, height);
}

}  // namespace filters
}  // namespace gobo

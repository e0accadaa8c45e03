// SPDX-License-Identifier: Apache-2.0
#include "filters/state_difference.h"

#include <algorithm>

#include "terms/dropped_samples.h"

namespace gobo {
inline namespace filters {

namespace {

class StateDifferenceNode final : public Node {
 public:
  StateDifferenceNode(int width, int height, int slots, int slot, int streams)
      : width_(width), height_(height), slots_(slots), slot_(slot), streams_(streams) {}
  std::string type() const override { return "state_difference"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(width_).add(height_).add(slots_).add(slot_).add(streams_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    w.over(0, {width_, height_, 1}).reads<double>(0, "sum", {3 * slots_}).reads<uint32_t>(0, "samples");
    w.over(1, {width_, height_, 1}).reads<double>(1, "sum", {3});
    if (streams_ > 1) w.reads<float>(0, "streams", {3 * slots_ * streams_}).reads<float>(1, "streams", {3 * streams_});
    w.require(slot_ >= 0 && slot_ < slots_, "the slot that it takes light off");
    TermShape out{"path_trace", Domain::Pixel, {width_, height_, 1}, {unsetPlane<double>("sum", 3 * slots_), unsetPlane<uint32_t>("samples")}};
    if (streams_ > 1) out.planes.push_back(unsetPlane<float>("streams", 3 * slots_ * streams_));
    passOnDropped(w.input(0), out);
    return w.gives(std::move(out));
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term &all = *ctx.inputs[0], &part = *ctx.inputs[1];
    const auto& out = ctx.result;
    const size_t pixels = size_t(width_) * size_t(height_), slots = size_t(slots_), slot = size_t(slot_);
    const auto sum = all.plane<double>("sum"), less = part.plane<double>("sum");
    const auto samples = all.plane<uint32_t>("samples");
    const auto outSum = out->writable<double>("sum");
    const auto outSamples = out->writable<uint32_t>("samples");
    const bool split = streams_ > 1;
    const std::span<const float> streams = split ? all.floats("streams") : std::span<const float>{};
    const std::span<const float> lessStreams = split ? part.floats("streams") : std::span<const float>{};
    const std::span<float> outStreams = split ? out->writable<float>("streams") : std::span<float>{};
    const bool complete = ctx.arena->parallelFor(
        pixels, 1 << 12,
        [&](size_t b, size_t e) {
          std::copy(sum.begin() + b * slots * 3, sum.begin() + e * slots * 3, outSum.begin() + b * slots * 3);
          std::copy(samples.begin() + b, samples.begin() + e, outSamples.begin() + b);
          for (size_t p = b; p < e; ++p)
            for (size_t c = 0; c < 3; ++c) {
              double& v = outSum[(p * slots + slot) * 3 + c];
              v = std::max(v - less[3 * p + c], 0.0);
            }
          if (!split) return;
          const size_t n = size_t(streams_);
          std::copy(streams.begin() + b * n * slots * 3, streams.begin() + e * n * slots * 3, outStreams.begin() + b * n * slots * 3);
          for (size_t k = b * n; k < e * n; ++k)
            for (size_t c = 0; c < 3; ++c) {
              float& v = outStreams[(k * slots + slot) * 3 + c];
              v = std::max(v - lessStreams[3 * k + c], 0.0f);
            }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    passOnDropped(all, *out);
    return TermPtr(out);
  }

 private:
  int width_, height_, slots_, slot_, streams_;
};

}  // namespace

NodePtr makeStateDifferenceNode(int width, int height, int slots, int slot, int streams) {
  return std::make_shared<StateDifferenceNode>(width, height, slots, slot, streams);
}

}  // namespace filters
}  // namespace gobo

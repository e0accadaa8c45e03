// SPDX-License-Identifier: Apache-2.0
#include "terms/caustics.h"

#include <algorithm>
#include <cstring>

#include "terms/dropped_samples.h"
#include "trace/sample_passes.h"

namespace gobo {
inline namespace terms {

namespace {

class CausticsNode final : public Node {
 public:
  CausticsNode(const CausticSettings& settings, const GBufferSettings& view, const SequenceShare& share)
      : settings_(settings),
        place_(view.place),
        width_(view.width ? view.width : settings.path.width),
        height_(view.width ? view.height : settings.path.height),
        share_(settings.path.viewSamples > 0 ? share : SequenceShare{}) {}
  std::string type() const override { return "caustics"; }
  // 2: without light that goes straight on; 3: tilted normals lose no specular light; 4: counted in passes; 5: tangents in the texture's own turn;
  // 6: cameras in volumes
  int version() const override { return 6; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kPathTracerFacets;
    t.extendable = true;
    t.tileable = true;
    t.persist = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    settings_.hash(h);
    if (!place_.whole()) h.add(width_).add(height_);
    place_.hash(h);
    if (share_.of > 1) h.add(share_.index).add(share_.of);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    return Wiring(type(), in, 0)
        .gives({type(), Domain::Pixel, {width_, height_, 1}, {plane<double>("sum", settings_.slots() * 3), plane<uint32_t>("samples"), mayDrop()}});
  }
  /// The photons of a pass with their sorted copy, if each lands once.
  size_t workingBytes() const override { return size_t(settings_.photons) * settings_.path.groupOf.size() * (2 * sizeof(Photon) + 24); }
  Cost cost(const TermShape&, uint32_t blocks) const override {
    const PathTracerSettings& s = settings_.path;
    const double maps = (samplesOf(blocks) + kBlockSamples - 1) / kBlockSamples, gathered = kReceiving * double(width_) * height_;
    const double rays = maps * double(settings_.photons) * double(s.groupOf.size()) + samplesOf(blocks) * gathered;
    return {rays, 400.0 * rays};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
    const auto tracer = CausticTracer::create(*ctx.scene, accel, settings_, ctx.stop);
    if (!tracer) return Status(Code::Cancelled, "stopped");
    const int width = width_, height = height_;
    const size_t perPixel = size_t(settings_.slots()) * 3;
    const auto& state = ctx.result;
    auto sum = state->writable<double>("sum");
    auto samples = state->writable<uint32_t>("samples");
    DroppedSamples dropped(*state);
    uint32_t pass = 0;
    if (ctx.previous && ctx.previous->extent() == state->extent() && ctx.previous->channels("sum") == int(perPixel)) {
      const auto oldSum = ctx.previous->plane<double>("sum");
      const auto oldSamples = ctx.previous->plane<uint32_t>("samples");
      const auto [least, most] = std::minmax_element(oldSamples.begin(), oldSamples.end());
      if (!oldSamples.empty() && *most <= samplesOf(ctx.targetBlocks)) {
        pass = passesFor(*least);
        const bool copied = ctx.arena->parallelFor(
            samples.size(), 1 << 12,
            [&](size_t begin, size_t end) {
              std::copy(oldSamples.begin() + begin, oldSamples.begin() + end, samples.begin() + begin);
              std::copy(oldSum.begin() + begin * perPixel, oldSum.begin() + end * perPixel, sum.begin() + begin * perPixel);
            },
            ctx.stop);
        if (!copied) return stopped(ctx, ctx.previous);
        passOnDropped(*ctx.previous, *state);
      }
    }
    std::shared_ptr<const PhotonMap> map;  // of a block of samples
    uint32_t mapped = 0;
    for (; pass < ctx.targetBlocks; ++pass) {
      const SamplePass now = samplePass(pass);
      if (!map || now.block != mapped) {
        uint64_t emitted = 0;
        map = tracer->emitPass(mapped = now.block, *ctx.arena, emitted, ctx.stop);
        ctx.counters->rays += emitted;
        if (!map) return stopped(ctx, state);
      }
      const bool complete = ctx.arena->parallelFor(
          size_t(height), 1,
          [&](size_t row, size_t) {
            uint64_t rays = 0;
            for (int x = 0; x < width; ++x) {
              const size_t p = row * size_t(width) + size_t(x);
              if (samples[p] != samplesOf(pass)) continue;  // an interrupted pass: this pixel has it already
              if (ctx.stop.stopRequested()) break;
              uint64_t lost = 0;
              const uint32_t own = now.block * kBlockSamples + now.first, turn = sharedFirst(own, now.count, share_) - own;
              tracer->traceSamples(place_.x + x, place_.y + int(row), {0, own, now.count}, *map, sum.data() + p * perPixel, rays, lost, turn);
              dropped.add(p, lost);
              samples[p] += now.count;
            }
            ctx.counters->rays += rays;
          },
          ctx.stop);
      if (!complete || ctx.stop.stopRequested()) return stopped(ctx, state);
      if (ctx.progress) ctx.progress(double(pass + 1) / double(ctx.targetBlocks));
    }
    return TermPtr(state);
  }

 private:
  static Status stopped(const RunContext& ctx, TermPtr state) {
    if (ctx.leavesState()) *ctx.park = std::move(state);
    return Status(Code::Cancelled, "stopped");
  }
  CausticSettings settings_;
  ViewPlace place_;
  int width_, height_;
  SequenceShare share_;
};

}  // namespace

NodePtr makeCausticsNode(const CausticSettings& settings, const GBufferSettings& view, const SequenceShare& share) {
  return std::make_shared<CausticsNode>(settings, view, share);
}

}  // namespace terms
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "terms/path_trace.h"

#include "terms/dropped_samples.h"
#include "trace/sample_passes.h"
#include "trace/sample_set.h"

#include <algorithm>
#include <cstring>

namespace gobo {
inline namespace terms {

namespace {

constexpr int kTile = 16;  // pixels a side: a tile of 16 samples a pixel takes about 2 ms, so stops are noticed in time

class PathTraceNode final : public Node {
 public:
  PathTraceNode(const PathTracerSettings& settings, int streams, const GBufferSettings& view, const SequenceShare& share)
      : settings_(settings),
        streams_(streams),
        share_(share),
        place_(view.place),
        width_(view.width ? view.width : settings.width),
        height_(view.width ? view.height : settings.height) {}
  std::string type() const override { return "path_trace"; }
  // 2: blocks continue one sequence; 3: volumes, every lobe; 4: light straight on; 5: bilinear environments; 6: tilted normals lose no specular light;
  // 7: every light in volumes, gentler roulette; 8: large finite values count; 9: hidden lights shine through delta events;
  // 10: of a lamp of few triangles those that face the receiver; 11: the first block is summed by passes;
  // 12: directions from maps without the C library's sines (last bits of a few); 13: near triangles' solid angles by one arc tangent (as 12);
  // 14: lamps with triangles of no area, tangents in the texture's own turn; 15: light at surfaces that let some of it straight on, around cameras in volumes
  int version() const override { return 15; }
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
    if (streams_ > 1) h.add(streams_);
    if (share_.of > 1) h.add("share").add(share_.index).add(share_.of);
    if (!place_.whole()) h.add(width_).add(height_);
    place_.hash(h);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    const int slots = settings_.groups * slotsPerGroup(settings_.split, settings_.maxBounces);
    TermShape out{type(), Domain::Pixel, {width_, height_, 1}, {plane<double>("sum", slots * 3), plane<uint32_t>("samples")}};
    if (streams_ > 1) out.planes.push_back(plane<float>("streams", slots * 3 * streams_));
    out.planes.push_back(mayDrop());
    return Wiring(type(), in, 0).gives(std::move(out));
  }
  Cost cost(const TermShape&, uint32_t blocks) const override {
    const PathTracerSettings& s = settings_;
    // Events that paths have: roulette ends most of them soon after it begins.
    const bool direct = has(s.cover, PathClass::Direct), indirect = has(s.cover, PathClass::Indirect);
    const double events = indirect ? std::min(double(s.maxBounces) + 1, double(s.rouletteStart) + 2) : direct ? 1.0 : 0.0;
    const double asks = events - (direct || events == 0 ? 0.0 : 1.0);
    const double rays = double(width_) * height_ * samplesOf(blocks) * (1.0 + kReceiving * (events + asks));
    return {rays, 130.0 * rays};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
    const auto tracer = PathTracer::create(*ctx.scene, accel, settings_, ctx.stop);
    if (!tracer) return Status(Code::Cancelled, "stopped");
    const int width = width_, height = height_, slots = tracer->slots();
    const auto& state = ctx.result;
    auto sum = state->writable<double>("sum");
    auto samples = state->writable<uint32_t>("samples");
    const size_t perStream = streams_ > 1 ? size_t(slots) * 3 : 0, perPixel = perStream * streams_;
    std::span<float> parts;
    if (perPixel) parts = state->writable<float>("streams");
    // An earlier state is taken over pixel by pixel, below: copying it whole would hold the cores between two polls.
    std::span<const double> oldSum;
    std::span<const float> oldParts;
    std::span<const uint32_t> oldSamples, oldDropped;
    if (ctx.previous && ctx.previous->extent() == state->extent() && ctx.previous->channels("sum") == slots * 3) {
      oldSum = ctx.previous->plane<double>("sum");
      oldSamples = ctx.previous->plane<uint32_t>("samples");
      if (perPixel) oldParts = ctx.previous->floats("streams");
      const uint32_t most = oldSamples.empty() ? 0 : *std::max_element(oldSamples.begin(), oldSamples.end());
      if (most > samplesOf(ctx.targetBlocks)) oldSamples = {};
      if (!oldSamples.empty()) oldDropped = droppedPlane(*ctx.previous);
    }
    DroppedSamples dropped(*state);

    // Tiles and groups lie as they do in the whole picture, of which this may be a part.
    const int left = place_.x / kTile * kTile, top = place_.y / kTile * kTile;
    const int tilesX = (place_.x + width - left + kTile - 1) / kTile, tilesY = (place_.y + height - top + kTile - 1) / kTile;
    const size_t tiles = size_t(tilesX) * tilesY;
    std::atomic<size_t> done{0};
    const bool complete = ctx.arena->parallelFor(
        tiles, 1,
        [&](size_t tile, size_t) {
          const int x0 = left + int(tile % tilesX) * kTile, y0 = top + int(tile / tilesX) * kTile;
          uint64_t rays = 0;
          std::vector<double> parted(perStream * kLanes);
          const auto place = [&](int x, int y) {  // of a pixel in the planes; -1: not of this part
            const int px = x - place_.x, py = y - place_.y;
            return px < 0 || py < 0 || px >= width || py >= height ? ptrdiff_t(-1) : ptrdiff_t(py) * width + px;
          };
          for (int k = 0; k < kTile * kTile && !oldSamples.empty(); ++k) {
            const ptrdiff_t at = place(x0 + k % kTile, y0 + k / kTile);
            if (at < 0) continue;
            const size_t p = size_t(at);
            std::memcpy(sum.data() + p * slots * 3, oldSum.data() + p * slots * 3, sizeof(double) * slots * 3);
            if (perPixel) std::copy_n(oldParts.begin() + p * perPixel, perPixel, parts.begin() + p * perPixel);
            samples[p] = oldSamples[p];
            if (!oldDropped.empty()) dropped.add(p, oldDropped[p]);
          }
          /// The pass's samples for the group at (x, y): of those pixels that have come so far.
          const auto trace = [&](uint32_t index, const PixelGroup& group, int x, int y) {
            const SamplePass pass = samplePass(index);
            ptrdiff_t at[kLanes];
            double* out[kLanes];
            bool wanted = false;
            for (int i = 0; i < group.pixels(); ++i) {
              at[i] = place(x + i % group.width, y + i / group.width);
              if (at[i] >= 0 && samples[size_t(at[i])] != samplesOf(index)) at[i] = -1;
              out[i] = at[i] < 0 ? nullptr : perPixel ? parted.data() + size_t(i) * perStream : sum.data() + size_t(at[i]) * slots * 3;
              wanted = wanted || out[i];
            }
            if (!wanted) return;
            std::fill_n(parted.begin(), perPixel ? size_t(group.pixels()) * perStream : 0, 0.0);
            uint64_t lost[kLanes] = {};
            const uint32_t stream = pass.block % uint32_t(streams_), block = pass.block / uint32_t(streams_);
            const uint32_t first = sharedFirst(block * kBlockSamples + pass.first, pass.count, share_);
            tracer->traceGroup(x, y, {stream, first, pass.count}, {out, size_t(group.pixels())}, rays, lost);
            for (int i = 0; i < group.pixels(); ++i) {
              if (!out[i]) continue;
              const size_t p = size_t(at[i]);
              double* const all = sum.data() + p * perStream;
              float* const part = perPixel ? parts.data() + p * perPixel + stream * perStream : nullptr;
              for (size_t c = 0; c < perStream; ++c) {
                all[c] += out[i][c];
                part[c] = float(double(part[c]) + out[i][c]);
              }
              dropped.add(p, lost[i]);
              samples[p] += pass.count;
            }
          };
          for (uint32_t index = 0; index < ctx.targetBlocks; ++index) {
            const PixelGroup group = pixelGroup(samplePass(index).count);
            for (int k = 0; k < kTile * kTile / group.pixels(); ++k) {
              if (ctx.stop.stopRequested()) {
                ctx.counters->rays += rays;
                return;
              }
              const int x = x0 + k % (kTile / group.width) * group.width, y = y0 + k / (kTile / group.width) * group.height;
              const ptrdiff_t at = place(x, y);
              if (index < kFirstPasses) trace(index, group, x, y);
              else  // whole blocks: pixel by pixel
                for (uint32_t i = at < 0 ? ctx.targetBlocks : passesFor(samples[size_t(at)]); i < ctx.targetBlocks && !ctx.stop.stopRequested(); ++i)
                  trace(i, group, x, y);
            }
            if (index >= kFirstPasses) break;
          }
          ctx.counters->rays += rays;
          if (ctx.stop.stopRequested()) return;
          const size_t now = ++done;
          if (ctx.progress && now % 16 == 0) ctx.progress(double(now) / double(tiles));
        },
        ctx.stop);
    if (!complete || ctx.stop.stopRequested()) {
      // Only a preempted render is asked for again; a cancelled one shall return at once.
      if (ctx.leavesState()) *ctx.park = oldSamples.empty() ? TermPtr(state) : merged(state, ctx.previous, slots);
      return Status(Code::Cancelled, "stopped");
    }
    return TermPtr(state);
  }

 private:
  /// What a stop parks of an extension: the pixels that were reached, and the earlier state where they were not.
  static TermPtr merged(const std::shared_ptr<Term>& state, const TermPtr& previous, int slots) {
    const auto sum = state->writable<double>("sum");
    const auto samples = state->writable<uint32_t>("samples");
    const bool split = state->hasPlane("streams");
    DroppedSamples dropped(*state);
    const std::span<const uint32_t> oldDropped = droppedPlane(*previous);
    const size_t perPixel = split ? size_t(state->channels("streams")) : 0;
    const std::span<float> parts = split ? state->writable<float>("streams") : std::span<float>{};
    const std::span<const float> oldParts = split ? previous->floats("streams") : std::span<const float>{};
    const auto oldSum = previous->plane<double>("sum");
    const auto oldSamples = previous->plane<uint32_t>("samples");
    bool untouched = true;
    for (size_t p = 0; p < samples.size() && untouched; ++p) untouched = samples[p] <= oldSamples[p];
    if (untouched) return previous;
    for (size_t p = 0; p < samples.size(); ++p) {
      if (samples[p] >= oldSamples[p]) continue;
      std::memcpy(sum.data() + p * slots * 3, oldSum.data() + p * slots * 3, sizeof(double) * slots * 3);
      if (split) std::copy_n(oldParts.begin() + p * perPixel, perPixel, parts.begin() + p * perPixel);
      samples[p] = oldSamples[p];
      if (!oldDropped.empty()) dropped.add(p, oldDropped[p]);  // nothing was traced here: its own count is 0
    }
    return state;
  }

  PathTracerSettings settings_;
  int streams_;
  SequenceShare share_;
  ViewPlace place_;
  int width_, height_;
};

}  // namespace

NodePtr makePathTraceNode(const PathTracerSettings& settings, int streams, const GBufferSettings& view, const SequenceShare& share) {
  return std::make_shared<PathTraceNode>(settings, streams, view, share);
}

}  // namespace terms
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "terms/path_trace.h"

#include <algorithm>
#include <cstring>

namespace gobo {

namespace {

constexpr int kTile = 16;   // pixels a side: a tile of 16 samples a pixel takes about 2 ms, so stops are noticed in time

class PathTraceNode final : public Node {
 public:
  explicit PathTraceNode(const PathTracerSettings& settings) : settings_(settings) {}
  std::string type() const override { return "path_trace"; }
  int version() const override { return 2; }                          // 2: blocks continue one sequence
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kPathTracerFacets;
    t.pathClass = settings_.cover;
    t.extendable = true;
    t.persist = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { settings_.hash(h); }
  size_t outputBytes() const override {
    return size_t(settings_.width) * settings_.height * (24u * settings_.groups * slotsPerGroup(settings_.split, settings_.maxBounces) + 4);
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto tracer = PathTracer::create(*ctx.scene, ctx.accels->get(*ctx.scene, *ctx.arena), settings_);
    const int width = settings_.width, height = settings_.height, slots = tracer->slots();
    auto state = std::make_shared<Term>("path_trace", Domain::Pixel, Extent{width, height, 1});
    auto sum = state->addPlane<double>("sum", slots * 3);
    auto samples = state->addPlane<uint32_t>("samples", 1);
    if (ctx.previous) {
      const auto s = ctx.previous->plane<double>("sum");
      const auto n = ctx.previous->plane<uint32_t>("samples");
      const uint32_t most = n.empty() ? 0 : *std::max_element(n.begin(), n.end());
      if (s.size() == sum.size() && n.size() == samples.size() && most <= ctx.targetBlocks * uint32_t(settings_.blockSize)) {
        std::memcpy(sum.data(), s.data(), s.size_bytes());
        std::memcpy(samples.data(), n.data(), n.size_bytes());
      }
    }

    const int tilesX = (width + kTile - 1) / kTile, tilesY = (height + kTile - 1) / kTile;
    const size_t tiles = size_t(tilesX) * tilesY;
    std::atomic<uint64_t> dropped{0};
    std::atomic<size_t> done{0};
    const bool complete = ctx.arena->parallelFor(tiles, 1, [&](size_t tile, size_t) {
      const int x0 = int(tile % tilesX) * kTile, y0 = int(tile / tilesX) * kTile;
      uint64_t rays = 0, lost = 0;
      for (int y = y0; y < std::min(height, y0 + kTile); ++y) {
        for (int x = x0; x < std::min(width, x0 + kTile); ++x) {
          const size_t p = size_t(y) * width + x;
          for (uint32_t block = samples[p] / settings_.blockSize; block < ctx.targetBlocks; ++block) {
            if (ctx.stop.stopRequested()) { ctx.counters->rays += rays; return; }
            tracer->traceBlock(x, y, block, sum.data() + p * slots * 3, rays, lost);
            samples[p] += settings_.blockSize;
          }
        }
      }
      ctx.counters->rays += rays;
      dropped += lost;
      const size_t now = ++done;
      if (ctx.progress && now % 16 == 0) ctx.progress(double(now) / double(tiles));
    }, ctx.stop);
    if (!complete || ctx.stop.stopRequested()) {
      if (ctx.park) *ctx.park = state;
      return Status(Code::Cancelled, "stopped");
    }
    return TermPtr(state);
  }

 private:
  PathTracerSettings settings_;
};

}  // namespace

NodePtr makePathTraceNode(const PathTracerSettings& settings) { return std::make_shared<PathTraceNode>(settings); }

}  // namespace gobo

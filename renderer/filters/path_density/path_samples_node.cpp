// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <atomic>
#include <cmath>

#include "filters/path_density/nodes.h"
#include "terms/dropped_samples.h"
#include "trace/path_sample_sink.h"
#include "trace/sample_passes.h"

namespace gobo::pathdensity {

namespace {

constexpr double kMostLight = 3.4e38;  // a float holds it

class PathSamplesNode final : public Node {
 public:
  explicit PathSamplesNode(const PathSamplesSettings& settings)
      : s_(settings), width_(s_.view.width ? s_.view.width : s_.path.width), height_(s_.view.width ? s_.view.height : s_.path.height) {}
  std::string type() const override { return "path_samples"; }
  int version() const override { return 5; }  // 2: as path_trace 12; 3: as 13; 4: as 14; 5: as 15
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kPathTracerFacets;
    t.extendable = true;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    s_.path.hash(h);
    h.add(s_.streams).add(width_).add(height_).add(uint64_t(s_.weights.size()));
    for (const Vec3& w : s_.weights) h.add(w.x).add(w.y).add(w.z);
    s_.view.place.hash(h);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 0);
    w.require(s_.weights.size() == size_t(s_.path.groups) * size_t(slotsPerGroup(s_.path.split, s_.path.maxBounces)), "a weight for each slot");
    return w.gives({type(), Domain::Pixel, {width_, height_, 1}, {unsetPlane<float>("film", 2), unsetPlane<float>("light", 3), mayDrop()}});
  }
  TermShape afterBlocks(TermShape one, uint32_t blocks) const override {
    const int samples = samplesAfter(blocks);
    for (PlaneShape& p : one.planes)
      if (p.format == Format::F32) p.channels *= samples;
    return one;
  }
  Cost cost(const TermShape&, uint32_t blocks) const override {
    const double events = s_.path.maxBounces > 0 ? std::min(double(s_.path.maxBounces) + 1, double(s_.path.rouletteStart) + 2) : 1.0;
    const double rays = double(width_) * height_ * samplesAfter(blocks) * (1.0 + kReceiving * 2 * events);
    return {rays, 150.0 * rays};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
    const int samples = samplesAfter(ctx.targetBlocks);
    PathTracerSettings settings = s_.path;
    settings.blockSize = std::min(samples, int(kBlockSamples));
    const auto tracer = PathTracer::create(*ctx.scene, accel, settings, ctx.stop);
    if (!tracer) return Status(Code::Cancelled, "stopped");
    const auto& out = ctx.result;
    const auto film = out->writable<float>("film"), light = out->writable<float>("light");
    DroppedSamples dropped(*out);
    // Blocks of 16 have the same bits wherever they are traced from; fewer samples are another grouping of the kernel's lanes.
    size_t had = 0;
    std::span<const float> oldFilm, oldLight;
    std::span<const uint32_t> oldDropped;
    if (ctx.previous && ctx.previous->type() == type() && ctx.previous->extent() == out->extent()) {
      const int before = ctx.previous->channels("film") / 2;
      if (before % int(kBlockSamples) == 0 && before <= samples) {
        had = size_t(before);
        oldFilm = ctx.previous->floats("film");
        oldLight = ctx.previous->floats("light");
        oldDropped = droppedPlane(*ctx.previous);
      }
    }
    std::atomic<int> done{0};
    const size_t n = size_t(samples);
    const bool complete = ctx.arena->parallelFor(
        size_t(height_), 1,
        [&](size_t y, size_t) {
          PathSampleSink sink({1, ~size_t(0)});
          uint64_t rays = 0;
          for (int x = 0; x < width_ && !ctx.stop.stopRequested(); ++x) {
            const size_t p = y * size_t(width_) + size_t(x);
            std::copy_n(oldFilm.begin() + ptrdiff_t(2 * p * had), 2 * had, film.begin() + ptrdiff_t(2 * p * n));
            std::copy_n(oldLight.begin() + ptrdiff_t(3 * p * had), 3 * had, light.begin() + ptrdiff_t(3 * p * n));
            uint64_t lost = oldDropped.empty() ? 0 : oldDropped[p];
            for (size_t first = had; first < n && !ctx.stop.stopRequested(); first += size_t(settings.blockSize))
              trace(*tracer, x, int(y), uint32_t(first) / uint32_t(settings.blockSize), film.subspan(2 * (p * n + first), 2 * size_t(settings.blockSize)),
                    light.subspan(3 * (p * n + first), 3 * size_t(settings.blockSize)), sink, rays, lost);
            dropped.add(p, lost);
          }
          if (ctx.counters) ctx.counters->rays += rays;
          const int now = ++done;
          if (ctx.progress && now % 16 == 0) ctx.progress(double(now) / height_);
        },
        ctx.stop);
    if (!complete || ctx.stop.stopRequested()) return Status(Code::Cancelled, "stopped");
    return TermPtr(out);
  }

 private:
  static int samplesAfter(uint32_t blocks) { return int(samplesOf(std::max(blocks, 1u))); }
  /// A block of pixel (x, y) of the view.
  void trace(const PathTracer& tracer, int x, int y, uint32_t block, std::span<float> film, std::span<float> light, PathSampleSink& sink, uint64_t& rays,
             uint64_t& lost) const {
    const uint32_t stream = block % uint32_t(s_.streams), ofStream = block / uint32_t(s_.streams);
    const int px = x + s_.view.place.x, py = y + s_.view.place.y;
    const size_t count = film.size() / 2;
    sink.clear();
    tracer.traceInto(px, py, stream * kBlocksPerStream + ofStream, sink, rays, lost);
    DVec3 sums[kLanes];
    for (size_t i = 0; i < count; ++i) {
      sums[i] = DVec3(0.0);
      film[2 * i] = float(x) + 0.5f;
      film[2 * i + 1] = float(y) + 0.5f;
    }
    const auto indexOf = [&](const PathSampleSink::Sample& s) { return size_t(s.sample - uint64_t(ofStream) * count); };
    for (const PathSampleSink::Sample& s : sink.samples()) {
      // Rounding may have left it outside its pixel.
      const auto inside = [](float v, int pixel, int from) { return std::clamp(v, float(pixel), std::nextafter(float(pixel + 1), 0.0f)) - float(from); };
      film[2 * indexOf(s)] = inside(s.film.x, px, s_.view.place.x);
      film[2 * indexOf(s) + 1] = inside(s.film.y, py, s_.view.place.y);
    }
    for (const PathSampleSink::Contribution& c : sink.contributions())
      forEachSlot(s_.path.split, c,
                  [&](int slot, const Vec3& value) { sums[indexOf(sink.samples()[c.sample])] += DVec3(s_.weights[size_t(slot)]) * DVec3(value); });
    for (size_t i = 0; i < count; ++i) {
      const DVec3& v = sums[i];
      const bool fits = std::abs(v.x) <= kMostLight && std::abs(v.y) <= kMostLight && std::abs(v.z) <= kMostLight;
      lost += fits ? 0 : 1;
      for (size_t k = 0; k < 3; ++k) light[3 * i + k] = fits ? float(v[int(k)]) : 0.0f;
    }
  }

  PathSamplesSettings s_;
  int width_, height_;
};

}  // namespace

NodePtr makePathSamplesNode(const PathSamplesSettings& settings) { return std::make_shared<PathSamplesNode>(settings); }

void readPathSamples(Wiring& w, size_t i, int width, int height) {
  w.over(i, {width, height, 1}).reads<float>(i, "film", {}).reads<float>(i, "light", {});
  w.require(w.channels(i, "film") >= 2 && w.channels(i, "film") % 2 == 0 && w.channels(i, "film") / 2 * 3 == w.channels(i, "light"), "samples in the planes");
}

SampleView pathSamplesOf(const Term& t) { return {t.extent().width, t.extent().height, t.floats("film"), {}, t.floats("light"), false}; }

}  // namespace gobo::pathdensity

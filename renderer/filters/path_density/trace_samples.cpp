// SPDX-License-Identifier: Apache-2.0
#include "filters/path_density/trace_samples.h"

#include <mutex>

#include "trace/path_sample_sink.h"

namespace gobo::pathdensity {

namespace {

struct TracedSample {
  int x = 0;
  Vec2 film{0.0f};
  Vec3 direct{0.0f}, indirect{0.0f};
};

/// Of one row, pixel by pixel.
std::vector<TracedSample> traceRow(const PathTracer& tracer, const PathTracerSettings& settings, int y, uint32_t first, uint32_t blocks, uint64_t& rays,
                                   uint64_t& dropped, const StopToken& stop) {
  std::vector<TracedSample> row;
  row.reserve(size_t(settings.width) * blocks * size_t(settings.blockSize));
  PathSampleSink sink({1, size_t(1) << 20});
  for (int x = 0; x < settings.width && !stop.stopRequested(); ++x)
    for (uint32_t b = 0; b < blocks; ++b) {
      sink.clear();
      tracer.traceInto(x, y, first + b, sink, rays, dropped);
      const size_t base = row.size();
      for (const PathSampleSink::Sample& s : sink.samples()) row.push_back({x, s.film, Vec3(0.0f), Vec3(0.0f)});
      for (const PathSampleSink::Contribution& c : sink.contributions()) {
        TracedSample& s = row[base + c.sample];
        (c.pathClass == PathClass::Emission || c.pathClass == PathClass::Direct ? s.direct : s.indirect) += c.value;
      }
    }
  return row;
}

}  // namespace

Result<PathSamples> traceSamples(const PathTracer& tracer, const PathTracerSettings& settings, uint32_t first, uint32_t blocks, size_t bytes,
                                 const TaskArena& arena, uint64_t& rays, uint64_t& dropped, const StopToken& stop) {
  PathSamples samples(settings.width, settings.height, bytes);
  GOBO_TRY(samples.reserve(size_t(settings.width) * size_t(settings.height) * blocks * size_t(settings.blockSize)));
  std::mutex counters;
  constexpr int kRowsAtOnce = 32;  // whose records are held twice
  for (int y0 = 0; y0 < settings.height; y0 += kRowsAtOnce) {
    const int rows = std::min(kRowsAtOnce, settings.height - y0);
    std::vector<std::vector<TracedSample>> traced(static_cast<size_t>(rows));
    const bool complete = arena.parallelFor(
        size_t(rows), 1,
        [&](size_t r, size_t) {
          uint64_t rowRays = 0, rowDropped = 0;
          traced[r] = traceRow(tracer, settings, y0 + int(r), first, blocks, rowRays, rowDropped, stop);
          const std::lock_guard lock(counters);
          rays += rowRays;
          dropped += rowDropped;
        },
        stop);
    if (!complete || stop.stopRequested()) return Status(Code::Cancelled, "stopped");
    for (int r = 0; r < rows; ++r)
      for (const TracedSample& s : traced[size_t(r)]) GOBO_TRY(samples.add(s.x, y0 + r, s.film, s.direct, s.indirect));
  }
  return samples;
}

}  // namespace gobo::pathdensity

// SPDX-License-Identifier: Apache-2.0
// The kernel, compiled for the sinks that keep records of paths. Apart from the pictures' one: it is as long again, and no part of its speed.
#include "trace/curvature_sums.h"
#include "trace/first_hit_sink.h"
#include "trace/path_group.h"
#include "trace/path_sample_sink.h"

namespace gobo {
inline namespace trace {

template void PathTracer::traceInto<FirstHitSink>(int, int, uint32_t, FirstHitSink&, uint64_t&, uint64_t&) const;
template void PathTracer::traceInto<PathSampleSink>(int, int, uint32_t, PathSampleSink&, uint64_t&, uint64_t&) const;

void traceCurvatureGroup(const PathTracer::Impl& m, int x, int y, const SampleRun& run, std::span<double* const> out, uint64_t& rays,
                         std::span<uint64_t> dropped) {
  traceGroupInto(m, x, y, run, out, CurvatureSums(m.settings, out), rays, dropped);
}

}  // namespace trace
}  // namespace gobo

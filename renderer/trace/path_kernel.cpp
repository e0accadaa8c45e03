// SPDX-License-Identifier: Apache-2.0
// The kernel, compiled for the sink of pictures.
#include "trace/path_group.h"
#include "trace/path_sums.h"

namespace gobo {
inline namespace trace {

template void PathTracer::traceInto<SumSink>(int, int, uint32_t, SumSink&, uint64_t&, uint64_t&) const;

void traceCurvatureGroup(const PathTracer::Impl& m, int x, int y, const SampleRun& run, std::span<double* const> out, uint64_t& rays,
                         std::span<uint64_t> dropped);  // path_sinks.cpp

void PathTracer::traceGroup(int x, int y, const SampleRun& run, std::span<double* const> out, uint64_t& rays, std::span<uint64_t> dropped) const {
  const PathTracerSettings& s = impl_->settings;
  if (s.split == SplitMode::ByLobeAndCurvature) return traceCurvatureGroup(*impl_, x, y, run, out, rays, dropped);
  traceGroupInto(*impl_, x, y, run, out, SumSink(s.split, impl_->slotCount, out), rays, dropped);
}

}  // namespace trace
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// The kernel, compiled for the sinks that keep records of paths. Apart from the pictures' one: it is as long again, and no part of its speed.
#include "trace/first_hit_sink.h"
#include "trace/path_sample_sink.h"
#include "trace/path_stages.h"

namespace gobo {

template void PathTracer::traceInto<FirstHitSink>(int, int, uint32_t, FirstHitSink&, uint64_t&, uint64_t&) const;
template void PathTracer::traceInto<PathSampleSink>(int, int, uint32_t, PathSampleSink&, uint64_t&, uint64_t&) const;

}  // namespace gobo

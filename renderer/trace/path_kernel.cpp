// SPDX-License-Identifier: Apache-2.0
// The kernel, compiled for the sink of pictures.
#include "trace/path_stages.h"
#include "trace/path_sums.h"

namespace gobo {

template void PathTracer::traceInto<SumSink>(int, int, uint32_t, SumSink&, uint64_t&, uint64_t&) const;

}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Path samples of a scene, from the path tracer.
#pragma once

#include "base/task_arena.h"
#include "filters/path_density/path_samples.h"
#include "trace/path_tracer.h"

namespace gobo::pathdensity {

/// Blocks [first, first + blocks) of the tracer's samples (settings.blockSize each), pixel by pixel in rows. Samples that the tracer drops are left out; adds
/// their number to `dropped`, rays to `rays`. Errors: ResourceExhausted beyond `bytes`; Cancelled.
Result<PathSamples> traceSamples(const PathTracer& tracer, const PathTracerSettings& settings, uint32_t first, uint32_t blocks, size_t bytes,
                                 const TaskArena& arena, uint64_t& rays, uint64_t& dropped, const StopToken& stop = {});

}  // namespace gobo::pathdensity

// SPDX-License-Identifier: Apache-2.0
// The path kernel. Include it where a sink of one's own is traced into, in one source file, and nowhere else (docs/add_a_sink.md); the
// sinks of this folder are compiled in path_kernel.cpp.
#pragma once

#include "trace/path_stage_camera.h"
#include "trace/path_stage_emission.h"
#include "trace/path_stage_lambert.h"
#include "trace/path_stage_shadow.h"
#include "trace/path_stage_surfaces.h"
#include "trace/path_stage_volumes.h"

namespace gobo {

/// Samples first .. first + count - 1 of the pixel's block; `film` is the index of the first over all blocks.
template <PathSink Sink>
void traceChunk(const PathTracer::Impl& m, int x, int y, const SampleSet& set, uint64_t film, int count, Sink& sink, uint64_t& rays, uint64_t& dropped) {
  PathChunk<Sink> chunk(m, sink, set, rays, x, y, film, count);
  sink.start(film, count);
  chunk.startAtCamera();
  for (; chunk.alive != 0; ++chunk.events) {  // one event of every lane
    chunk.intersect();
    chunk.drawNumbers();
    if (chunk.hasMedia) chunk.walkVolumes();
    chunk.meetLights();
    chunk.scatterAtSurfaces();
    chunk.scatterAtLambert();
    if (chunk.shadowed != 0) chunk.traceShadowRays();
    chunk.alive = m.onlyUnlit ? chunk.next & chunk.paths.specularOnly : chunk.next;
  }
  sink.finish(chunk.bad);
  dropped += uint64_t(__builtin_popcount(chunk.bad));
}

template <class Sink>
void PathTracer::traceInto(int x, int y, uint32_t block, Sink& sink, uint64_t& rays, uint64_t& dropped) const {
  static_assert(PathSink<Sink>);
  const Impl& m = *impl_;
  const int size = m.settings.blockSize;
  const uint64_t pixel = uint64_t(uint32_t(y)) << 32 | uint32_t(x);
  const uint64_t seed = hash64(hash64(m.settings.seed, pixel), block / kBlocksPerStream);
  const uint32_t begin = block % kBlocksPerStream * uint32_t(size);
  for (int first = 0; first < size; first += kLanes) {
    const SampleSet set(seed, begin + uint32_t(first));
    traceChunk(m, x, y, set, uint64_t(begin) + uint64_t(first), std::min(kLanes, size - first), sink, rays, dropped);
  }
}

}  // namespace gobo

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
inline namespace trace {

/// The samples of these lanes; gives back those that were dropped.
template <PathSink Sink>
uint32_t traceChunk(const PathTracer::Impl& m, const ChunkLanes& who, const SampleSet& set, Sink& sink, uint64_t& rays) {
  PathChunk<Sink> chunk(m, sink, set, who, rays);
  sink.start(who.film[0], __builtin_popcount(who.present));
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
  return chunk.bad;
}

template <class Sink>
void PathTracer::traceInto(int x, int y, uint32_t block, Sink& sink, uint64_t& rays, uint64_t& dropped) const {
  static_assert(PathSink<Sink>);
  const Impl& m = *impl_;
  const int size = m.settings.blockSize;
  const uint64_t seed = pixelSeed(m.settings.seed, x, y, block / kBlocksPerStream);
  const uint32_t begin = block % kBlocksPerStream * uint32_t(size);
  ChunkLanes who;
  std::fill_n(who.x, kLanes, x);
  std::fill_n(who.y, kLanes, y);
  for (int first = 0; first < size; first += kLanes) {
    const int count = std::min(kLanes, size - first);
    who.present = (1u << count) - 1;
    for (int i = 0; i < kLanes; ++i) who.film[i] = uint64_t(begin) + uint64_t(first + i);
    dropped += uint64_t(__builtin_popcount(traceChunk(m, who, SampleSet(seed, begin + uint32_t(first), m.settings.sampler), sink, rays)));
  }
}

}  // namespace trace
}  // namespace gobo

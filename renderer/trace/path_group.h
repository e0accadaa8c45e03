// SPDX-License-Identifier: Apache-2.0
// A few samples each of neighbouring pixels, so that the kernel's lanes are full. Include it where trace/path_stages.h may be.
#pragma once

#include "base/check.h"
#include "trace/path_stages.h"

namespace gobo {
inline namespace trace {

/// Samples of the pixels of a group (PathTracer::traceGroup) into a sink of sums to `out`.
template <class Sums>
void traceGroupInto(const PathTracer::Impl& m, int x, int y, const SampleRun& run, std::span<double* const> out, Sums&& sums, uint64_t& rays,
                    std::span<uint64_t> dropped) {
  const PathTracerSettings& s = m.settings;
  const PixelGroup group = pixelGroup(run.count);
  const int each = int(run.count);
  GOBO_CHECK_EQ(int(out.size()), group.pixels());
  GOBO_CHECK_EQ(each * group.pixels(), kLanes);
  ChunkLanes who;
  uint64_t seeds[kLanes];
  for (int p = 0; p < group.pixels(); ++p) {
    const int px = x + p % group.width, py = y + p / group.width;
    seeds[p] = pixelSeed(s.seed, px, py, run.stream);
    // All that the film has of the group, wanted or not: which rays go together may decide between triangles at the same distance.
    if (px < s.width && py < s.height) who.present |= ((1u << each) - 1) << (p * each);
    for (int i = 0; i < each; ++i) {
      who.x[p * each + i] = px;
      who.y[p * each + i] = py;
      who.film[p * each + i] = uint64_t(run.first) + uint64_t(i);
    }
  }
  const uint32_t bad = traceChunk(m, who, SampleSet(std::span<const uint64_t>(seeds, size_t(group.pixels())), run.first, s.sampler), sums, rays);
  for (int p = 0; p < group.pixels(); ++p)
    if (out[size_t(p)]) dropped[size_t(p)] += uint64_t(__builtin_popcount(bad >> (p * each) & ((1u << each) - 1)));
}

}  // namespace trace
}  // namespace gobo

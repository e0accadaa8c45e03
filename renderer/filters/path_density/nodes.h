// SPDX-License-Identifier: Apache-2.0
// Nodes of path density: a source of path samples, and the filter.
#pragma once

#include "filters/path_density/path_density.h"
#include "terms/gbuffer.h"
#include "terms/node.h"
#include "trace/path_tracer.h"

namespace gobo::pathdensity {

/// Bytes of a sample in a term.
inline constexpr size_t kTermBytesOfSample = 5 * sizeof(float);

struct PathSamplesSettings {
  PathTracerSettings path;    ///< its samples are the path tracer's own, whatever the weights; blockSize does not matter
  std::vector<Vec3> weights;  ///< by slot: how much of its light counts
  int streams = 1;            ///< as of makePathTraceNode()
  GBufferSettings view;       ///< the part of the settings' picture that is traced; of no width: all of it
};
/// Extendable, its blocks being the passes of trace/sample_passes.h. Output: "path_samples" of pixels, n samples each: planes film f32 x 2n, from the term's
/// left upper corner; light f32 x 3n. What the tracer drops, or is beyond a float, is black, as in its pictures, and counted (terms/dropped_samples.h).
/// Whole blocks are gone on from; fewer than 16 samples are traced again. A stopped run leaves nothing behind.
NodePtr makePathSamplesNode(const PathSamplesSettings& settings);

/// A filter reads input `i`, path samples of width x height pixels.
void readPathSamples(Wiring& wiring, size_t i, int width, int height);
/// Of such a term, which must live as long.
SampleView pathSamplesOf(const Term& term);

/// Inputs: path samples of a picture width x height; where settings.metric.white is 0, which stands for its choice by whiteOf() (outliers/white.h), the other
/// light of the picture too (rgb). Output: "path_density", planes rgb f32x3: what is kept; rejected f32x3: rgb + rejected is the mean of all samples;
/// weight f32: mean weight of the pixel's samples, 0 .. 1; with settings.first also first f32x3, with settings.density density f32. Errors: InvalidArgument, of
/// settings (path_density.h).
NodePtr makePathDensityNode(const Settings& settings, int width, int height);

}  // namespace gobo::pathdensity

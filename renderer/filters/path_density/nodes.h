// SPDX-License-Identifier: Apache-2.0
// Nodes of path density: a source of path samples, and the filter.
#pragma once

#include "filters/path_density/path_density.h"
#include "terms/node.h"
#include "trace/path_tracer.h"

namespace gobo::pathdensity {

struct PathSamplesSettings {
  PathTracerSettings path;         ///< blockSize and cover among them; split does not matter
  uint32_t blocks = 1;             ///< of path.blockSize samples a pixel
  size_t bytes = size_t(1) << 30;  ///< limit of what samples may take (PathSamples)
};
/// Output: "path_samples", a list of at most width * height * blocks * blockSize samples (fewer where the tracer dropped some, or they were not finite), pixel
/// by pixel: planes film f32x2 in pixels, direct and indirect f32x3. Errors: ResourceExhausted beyond the limit.
NodePtr makePathSamplesNode(const PathSamplesSettings& settings);

/// Input: path samples of a picture width x height. Output: "path_density", planes rgb f32x3: what is kept; rejected f32x3: rgb + rejected is the mean of all
/// samples; weight f32: mean weight of the pixel's samples, 0 .. 1; with settings.density also density f32. Errors: InvalidArgument, of settings
/// (path_density.h).
NodePtr makePathDensityNode(const Settings& settings, int width, int height);

}  // namespace gobo::pathdensity

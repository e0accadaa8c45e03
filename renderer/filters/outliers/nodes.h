// SPDX-License-Identifier: Apache-2.0
// The estimators of sample_estimators.h as nodes. Input 0: path samples (path_density/nodes.h) of width x height pixels. Output: plane rgb f32x3.
#pragma once

#include "filters/outliers/sample_estimators.h"
#include "terms/node.h"

namespace gobo::outliers {

NodePtr makeTrimmedMeanNode(double share, int width, int height);
NodePtr makeMedianOfMeansNode(int buckets, int width, int height);
/// settings.start 0 stands for whiteOf() (white.h) of the picture, whose other light (rgb) is input 1 then: of windows it knows nothing then.
NodePtr makeReweightedMeanNode(const Reweighting& settings, int width, int height);

/// The mean of the samples of each pixel and `rest` (RGB): white of it.
Result<float> whiteOfSamples(const SampleView& samples, std::span<const float> rest, const TaskArena& arena, const StopToken& stop);

}  // namespace gobo::outliers

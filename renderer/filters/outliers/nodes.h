// SPDX-License-Identifier: Apache-2.0
// The estimators of sample_estimators.h as nodes. Input 0: path samples (path_density/nodes.h) of width x height pixels. Output: planes rgb f32x3 and, with
// first > 0, first f32x3: the same of the first so many samples of each pixel, as re-weighting weighs them among all.
#pragma once

#include "filters/outliers/sample_estimators.h"
#include "terms/node.h"

namespace gobo::outliers {

NodePtr makeTrimmedMeanNode(double share, int width, int height, int first = 0);
NodePtr makeMedianOfMeansNode(int buckets, int width, int height, int first = 0);
/// settings.start 0 stands for whiteOf() (white.h) of the picture, whose other light (rgb) is input 1 then: of windows it knows nothing then.
NodePtr makeReweightedMeanNode(const Reweighting& settings, int width, int height, int first = 0);

/// The mean of the samples of each pixel and `rest` (RGB): white of it.
Result<float> whiteOfSamples(const SampleView& samples, std::span<const float> rest, const TaskArena& arena, const StopToken& stop);

}  // namespace gobo::outliers

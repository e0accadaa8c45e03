// SPDX-License-Identifier: Apache-2.0
// What the samples of path-traced pixels say about themselves. Inputs: path tracing states (terms/path_trace.h) of one size.
#pragma once

#include <vector>

#include "terms/node.h"

namespace gobo {
inline namespace filters {

/// Output: "pixels", plane "count" f32: samples of the pixel, the smallest over the states; 0 without any.
NodePtr makeSampleCountNode(int width, int height);

struct VarianceWeight {
  int input = 0, slot = 0;
  Vec3 weight{1.0f};
};
/// Variance of the pixel mean of sum(weight * slot), by channel. The states have `streams` independent streams of blocks of samples
/// (trace/sample_passes.h). With x_k the mean of stream k over its n_k samples and N = sum n_k: sum n_k (x_k - mean)^2 / ((K - 1) N), K the streams that
/// have samples: unbiased when the n_k are equal (a multiple of K blocks); its own relative standard error is about sqrt(2 / (K - 1)) and
/// more for skewed pixels. Streams of different states share their numbers, so they are added before they are compared.
/// Output: "pixels", plane "variance" f32x3; -1 where fewer than two streams have samples (unknown). Cost: one pass over the streams.
NodePtr makeVarianceNode(std::vector<VarianceWeight> weights, int inputs, int width, int height, int streams);

}  // namespace filters
}  // namespace gobo

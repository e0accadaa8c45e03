// SPDX-License-Identifier: Apache-2.0
// A shutter's picture without noise: its slices have few samples each, of which a filter can make little, so that their mean is filtered, which has all of them
// (docs/noise.md, docs/camera.md).
#pragma once

#include <span>
#include <string>
#include <vector>

#include "filters/slice_sum.h"
#include "plan/denoised.h"

namespace gobo {
inline namespace plan {

/// Whether slices are put together before they are filtered. denoise.axis_aligned filters them one by one, for pixels along edges by their view samples, which
/// are of one moment.
bool filtersMeanOfSlices(const v1::RenderRequest& request);

/// Where a slice sum has what a filter of it needs: the first plane of features (and of the lens' blur), and of light.
struct NoisyPlanes {
  size_t features = 0, light = 0;
};
/// Appends what a slice sum needs of each slice. Outputs of one picture share its features: those of `shared`, unless it is null.
NoisyPlanes slicedPlanes(const NoisySlice& slice, std::vector<SlicePlane>& planes, const NoisyPlanes* shared);
/// And a slice's nodes in the same order; `seen`: without its features.
void addNoisySlice(const NoisySlice& slice, std::vector<NodeId>& nodes, bool seen);

/// The filtered mean and what was not filtered, plane "rgb", of a slice sum that has `at`; `of`: one of its `slices` slices. lit: there is light to filter in
/// any slice.
Result<NodeId> planDenoisedSlices(Graph& graph, const v1::RenderRequest& request, NodeId sum, const NoisyPlanes& at, const NoisySlice& of, bool lit, int slices,
                                  int width, int height, const std::string& label);

}  // namespace plan
}  // namespace gobo

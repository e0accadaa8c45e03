// SPDX-License-Identifier: Apache-2.0
// Sums of what techniques brought (technique/plan_sum.h) without noise (request.denoise, docs/noise.md).
#pragma once

#include <span>
#include <string>

#include "technique/plan_sum.h"

namespace gobo {
inline namespace plan {

/// A filter that asks for how indirect light bends along surfaces (Distinctions::curvature). groups: of lights that are traced apart. denoise.auto does without
/// where the sums and means of the picture's samples would take more than kMostCurvatureBytes (their first half is as large again).
bool needsCurvature(const v1::RenderRequest& request, size_t groups);
inline constexpr uint64_t kMostCurvatureBytes = 1ull << 30;

/// planSum, where what was path traced, but for light that the camera sees itself, loses its outliers (plan/outliers.h) and goes through the filter that the
/// request names, each if it does. The halves that it
/// looks at are the first half of the samples and the rest: no sample is traced for it, and none is other than without it.
Result<NodeId> planDenoised(PlanContext& c, std::span<const Contribution> contributions, const std::string& label);

/// What is said of such a picture (GraphNode::approximate).
inline constexpr const char* kDenoisedApproximate = "without noise, and without what of the light looks like it";

/// Light that is filtered together, before it is taken apart from its textures (planes "rgb").
struct NoisyNodes {
  NodeId features = -1, first = -1, all = -1;  ///< first: of `firstSamples` of all `samples`; -1: there is one
  NodeId bending = -1;                         ///< how it bends along surfaces; -1: unknown
  uint32_t samples = 1, firstSamples = 0;
};

/// What a slice of a shutter's picture brings to filters of their mean (plan/denoised_slices.h).
struct NoisySlice {
  NoisyNodes light;    ///< features: as view samples see them
  NodeId blur = -1;    ///< lens_blur; -1: no slice has a lens
  NodeId others = -1;  ///< what is not filtered: plane "rgb"
  bool lit = false;    ///< there is any light to filter
};
Result<NoisySlice> planNoisySlice(PlanContext& c, std::span<const Contribution> contributions, const std::string& label);
/// The filters that the request names, of light in two halves of which nothing is known but them and the features: the demodulated light, plane "rgb". -1: it
/// names none.
Result<NodeId> planFiltered(Graph& graph, const v1::Denoise& settings, const NoisyNodes& light, int width, int height, const std::string& label);

}  // namespace plan
}  // namespace gobo

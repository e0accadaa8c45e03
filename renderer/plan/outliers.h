// SPDX-License-Identifier: Apache-2.0
// Path-traced light without outliers among its samples (request.denoise.outliers, docs/path_density.md).
#pragma once

#include <span>
#include <string>
#include <vector>

#include "technique/plan_context.h"

namespace gobo {
inline namespace plan {

/// What of `brought` is judged comes as one contribution for each state and class instead, made of samples that no other node traces: the light that the path
/// tracer's own picture has, weights in it, so that other gains are other samples. The rest as it is.
/// Their nodes have a plane kFirstSamples of the first `first` samples too, unless that is 0, by the weights that these have among all.
std::vector<Contribution> withoutOutliers(PlanContext& c, std::span<const Contribution> brought, const std::string& label, uint32_t first);
inline constexpr const char* kFirstSamples = "first";

/// Errors: InvalidArgument: thresholds in the wrong order, a white too near to 0; ResourceExhausted: more samples than are held one by one. Each names the
/// field.
Status checkOutliers(const v1::RenderRequest& resolved);
/// How many samples a pixel may have, for requests that leave their number open; what any number may be where no samples are held.
uint32_t mostSamples(const v1::RenderRequest& resolved, uint32_t most);

}  // namespace plan
}  // namespace gobo

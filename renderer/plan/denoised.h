// SPDX-License-Identifier: Apache-2.0
// Sums of what techniques brought, and the same without noise (request.denoise, docs/noise.md).
#pragma once

#include <span>
#include <string>

#include "technique/plan_context.h"

namespace gobo {

/// Weighted sum of the contributions: a node with the plane "rgb".
NodeId planSum(PlanContext& c, std::span<const Contribution> contributions, const std::string& label);

/// A filter that asks for how indirect light bends along surfaces (Distinctions::curvature). groups: of lights that are traced apart. denoise.auto does without
/// where the sums and means of the picture's samples would take more than kMostCurvatureBytes (their first half is as large again).
bool needsCurvature(const v1::RenderRequest& request, size_t groups);
inline constexpr uint64_t kMostCurvatureBytes = 1ull << 30;

/// The same, where what was path traced, but for light that the camera sees itself, loses its outliers (plan/outliers.h) and goes through the filter that the
/// request names, each if it does. The halves that it
/// looks at are the first half of the samples and the rest: no sample is traced for it, and none is other than without it.
Result<NodeId> planDenoised(PlanContext& c, std::span<const Contribution> contributions, const std::string& label);

}  // namespace gobo

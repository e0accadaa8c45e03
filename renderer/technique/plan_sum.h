// SPDX-License-Identifier: Apache-2.0
// Sums of what techniques bring.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "filters/expression.h"
#include "technique/plan_context.h"

namespace gobo {
inline namespace technique {

/// Adds the contributions to `sum` (-1: nothing yet), their nodes to `inputs`.
void addTo(Expression& e, std::vector<NodeId>& inputs, int& sum, std::span<const Contribution> contributions);

/// Their weighted sum, plane "rgb"; of none: black.
NodeId planSum(PlanContext& c, std::span<const Contribution> contributions, const std::string& label);

}  // namespace technique
}  // namespace gobo

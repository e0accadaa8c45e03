// SPDX-License-Identifier: Apache-2.0
#include "technique/plan_sum.h"

#include <algorithm>

#include "filters/composite.h"

namespace gobo {
inline namespace technique {

void addTo(Expression& e, std::vector<NodeId>& inputs, int& sum, std::span<const Contribution> contributions) {
  for (const Contribution& k : contributions) {
    auto at = std::find(inputs.begin(), inputs.end(), k.node);
    if (at == inputs.end()) at = inputs.insert(inputs.end(), k.node);
    const int plane = e.plane(int(at - inputs.begin()), k.plane);
    if (sum < 0) sum = e.constant(Vec3(0.0f));
    sum = e.multiplyAdd(sum, k.weight, plane);
  }
}

NodeId planSum(PlanContext& c, std::span<const Contribution> contributions, const std::string& label) {
  Expression e;
  std::vector<NodeId> inputs;
  int sum = -1;
  addTo(e, inputs, sum, contributions);
  if (sum < 0) e.constant(Vec3(0.0f));
  return c.filter(makeCompositeNode(std::move(e), c.view().width, c.view().height), std::move(inputs), label);
}

}  // namespace technique
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "terms/node.h"

#include <algorithm>
#include <chrono>

#include "trace/accel.h"

namespace gobo {
inline namespace terms {

Result<AccelPtr> RunContext::accel() const {
  const auto begun = std::chrono::steady_clock::now();
  AccelPtr made = accels->get(*scene, *arena, stop);
  if (counters) counters->accelNs += uint64_t(std::chrono::nanoseconds(std::chrono::steady_clock::now() - begun).count());
  if (!made) return Status(Code::Cancelled, "stopped");
  return made;
}

Cost costBeyond(const Node& node, const TermShape& result, uint32_t blocks, uint32_t before) {
  const Cost all = node.cost(result, blocks);
  if (before == 0) return all;
  const Cost there = node.cost(result, std::min(before, blocks));
  return {std::max(all.rays - there.rays, 0.0), std::max(all.ns - there.ns, 0.0)};
}

Result<TermPtr> runNode(const Node& node, const TermShape& shape, RunContext& ctx) {
  ctx.result = makeTerm(shape);
  GOBO_ASSIGN(TermPtr made, node.run(ctx));
  ctx.result.reset();
  GOBO_TRY(shape.holds(*made));
  return made;
}

Result<TermPtr> runNode(const Node& node, RunContext& ctx) {
  std::vector<TermShape> in;
  for (const TermPtr& input : ctx.inputs) in.push_back(shapeOf(*input));
  GOBO_ASSIGN(TermShape shape, node.infer(in));
  return runNode(node, node.afterBlocks(std::move(shape), ctx.targetBlocks), ctx);
}

}  // namespace terms
}  // namespace gobo

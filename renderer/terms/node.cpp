// SPDX-License-Identifier: Apache-2.0
#include "terms/node.h"

#include "trace/accel.h"

namespace gobo {
inline namespace terms {

Result<AccelPtr> RunContext::accel() const {
  AccelPtr made = accels->get(*scene, *arena, stop);
  if (!made) return Status(Code::Cancelled, "stopped");
  return made;
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

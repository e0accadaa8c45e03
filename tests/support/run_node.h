// SPDX-License-Identifier: Apache-2.0
// Nodes of a scene run by hand: no graph, no store.
#pragma once

#include <gtest/gtest.h>

#include "terms/node.h"
#include "trace/accel.h"

namespace gobo::tests {

class NodeRunner {
 public:
  NodeRunner(const Scene& scene, const TaskArena& arena) : scene_(scene), arena_(arena) {}
  /// `lights`: what the node may see of them.
  TermPtr operator()(const NodePtr& node, std::vector<TermPtr> inputs, const std::vector<int>& lights = {}) {
    const SceneView view(scene_, node->traits().facets, lights);
    RunContext c;
    c.scene = &view;
    c.inputs = std::move(inputs);
    c.arena = &arena_;
    c.accels = &accels_;
    c.counters = &counters_;
    Result<TermPtr> r = runNode(*node, c);
    EXPECT_TRUE(r.ok()) << r.status().toString();
    return r.ok() ? *r : nullptr;
  }

 private:
  const Scene& scene_;
  const TaskArena& arena_;
  AccelCache accels_;
  RunCounters counters_;
};

}  // namespace gobo::tests

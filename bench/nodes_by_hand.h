// SPDX-License-Identifier: Apache-2.0
// Nodes of a scene run one after the other, without a graph or a store: for figures of what no request renders. A node that fails ends the program.
#pragma once

#include <cstdio>
#include <cstdlib>

#include "terms/node.h"
#include "trace/accel.h"

namespace gobo {

class NodesByHand {
 public:
  NodesByHand(ScenePtr scene, int threads) : scene_(std::move(scene)), arena_(threads) {}
  const Scene& scene() const { return *scene_; }
  const TaskArena& arena() const { return arena_; }
  SceneView view(Facet facets) const { return SceneView(*scene_, facets, noLights_); }
  AccelPtr accel() { return accels_.get(view(kAccelFacets), arena_); }
  TermPtr operator()(const NodePtr& node, std::vector<TermPtr> inputs) {
    const SceneView seen = view(node->traits().facets);
    RunContext c;
    c.scene = &seen;
    c.inputs = std::move(inputs);
    c.arena = &arena_;
    c.accels = &accels_;
    c.counters = &counters_;
    Result<TermPtr> r = runNode(*node, c);
    if (r.ok()) return *r;
    std::fprintf(stderr, "%s: %s\n", node->type().c_str(), r.status().toString().c_str());
    std::exit(1);
  }

 private:
  ScenePtr scene_;
  TaskArena arena_;
  AccelCache accels_;
  RunCounters counters_;
  std::vector<int> noLights_;
};

}  // namespace gobo

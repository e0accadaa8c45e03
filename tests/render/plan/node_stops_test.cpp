// SPDX-License-Identifier: Apache-2.0
// Every node of every kind of plan, one by one: with a token that has fired it does not finish; with one that has not it looks at it all
// along, however cheap its work (a pass over a large picture that does not look holds the cores for a third of a second).
#include <gtest/gtest.h>

#include <set>

#include "support/planned_nodes.h"
#include "support/stopping.h"
#include "support/thorough.h"

namespace gobo::testing {
namespace {

using tests::pollsOf;
using tests::stoppedAlready;

/// Most elements of its result that a node makes between two polls.
constexpr size_t kElementsAPoll = 1 << 15;

TEST(NodeStops, NoNodeFinishesOnceItsTokenHasFired) {
  std::set<std::string> types, kinds;
  size_t repeated = 0;
  for (const auto& [name, request] : requestsWithAllNodes(24, 16)) {
    Planned p(request);
    ASSERT_NE(p.plan, nullptr);
    for (NodeId id = 0; id < p.plan->graph.size(); ++id) {
      const GraphNode& n = p.plan->graph.at(id);
      types.insert(n.node->type());
      std::string kind = n.node->type();
      for (const NodeId i : n.inputs) kind += " " + p.plan->graph.at(i).node->type();
      if (!kinds.insert(kind).second && !inSweep(repeated++, 4)) continue;
      const auto result = p.run(id, stoppedAlready());
      EXPECT_FALSE(result.ok()) << name << ", node " << n.label << " (" << n.node->type() << ")";
      if (result.ok()) continue;
      EXPECT_EQ(result.status().code(), Code::Cancelled) << name << ", node " << n.label << ": " << result.status().toString();
    }
  }
  EXPECT_GE(types.size(), 30u);
  for (const char* type : {"resolve", "pixel_mean", "shade", "direct_fold", "alpha", "composite", "path_trace", "caustics", "gbuffer"})
    EXPECT_TRUE(types.count(type)) << type;
}

TEST(NodeStops, EveryNodeLooksAtItsTokenAllAlong) {
  const std::set<std::string> drawn{"ray_traced", "axis_aligned", "environment.area_lights=6", "cluster"};  // the others' own nodes work texel by texel
  for (const auto& [name, request] : requestsWithAllNodes(224, 160)) {
    if (!drawn.count(name)) continue;
    Planned p(request);
    ASSERT_NE(p.plan, nullptr);
    for (NodeId id = 0; id < p.plan->graph.size(); ++id) {
      const GraphNode& n = p.plan->graph.at(id);
      size_t elements = 0;
      const int polls = pollsOf([&](const StopToken& s) {
        const auto result = p.run(id, s);
        ASSERT_TRUE(result.ok()) << n.label << ": " << result.status().toString();
        elements = (*result)->extent().elements();
      });
      EXPECT_GE(size_t(polls), (elements + kElementsAPoll - 1) / kElementsAPoll)
          << name << ", node " << n.label << " (" << n.node->type() << "), " << elements << " elements";
    }
  }
}

TEST(NodeStops, TheCheckForNonFiniteValuesStops) {
  Term term("big", Domain::Pixel, {2048, 1024, 1});
  (void)term.addPlane<float>("v", 3);
  TaskArena arena(1);
  EXPECT_GE(pollsOf([&](const StopToken& s) { ASSERT_TRUE(firstNonFinite(term, arena, s).ok()); }), 24);
  EXPECT_EQ(firstNonFinite(term, arena, stoppedAlready()).status().code(), Code::Cancelled);
}

}  // namespace
}  // namespace gobo::testing

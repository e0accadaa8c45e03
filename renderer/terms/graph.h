// SPDX-License-Identifier: Apache-2.0
// Graph: the DAG of nodes that a request needs. Grows while it is planned (expanders evaluate a node, then add more).
// Structurally equal nodes are one node. Not thread-safe; one per request.
#pragma once

#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "terms/node.h"

namespace gobo {
inline namespace terms {

using NodeId = int;

struct GraphNode {
  NodePtr node;
  std::vector<NodeId> inputs;
  std::vector<int> lights;  ///< subset of the scene's lights that the node reads (light facets of its key)
  std::string label;        ///< for reports: "visibility:sun"
  uint32_t blocks = 0;      ///< extendable nodes: blocks asked for
  ScenePtr scene;           ///< the effective scene that the node sees (null for filters)
  bool transient = false;   ///< result is not kept in the store (inputs of folds)
  std::string approximate;  ///< for reports: in what its result is more than noise away from the truth; empty: in nothing
  TermShape shape;          ///< of the result; made by Graph::add
};

struct PrunedNode {
  std::string label, reason;
  bool approximate = false;
};

/// Upper bound of the bytes that a node's result has and its run takes.
inline uint64_t outputBytes(const GraphNode& n) { return n.shape.bytes() + n.node->workingBytes() + kTermBytes; }

class Graph {
 public:
  /// Adds, or finds the structurally equal node. `scene` may be null for filters. A node that cannot read its inputs makes wiring() an error.
  NodeId add(GraphNode node);
  /// The first thing that is wired wrongly: nothing of the graph may be run then.
  Status wiring() const { return wrong_ ? wrong_->second : Status(); }
  /// Marks node `id`, and nodes from `first` on that were added for it, as not kept in the store (inputs of folds).
  void markTransient(NodeId first, NodeId id) {
    for (NodeId i = first; i <= id; ++i) nodes_[i].transient = true;
  }
  /// For reports: nodes from `first` on.
  void addToLabels(NodeId first, const std::string& suffix) {
    for (NodeId i = first; i < size(); ++i) nodes_[size_t(i)].label += suffix;
  }
  /// As it is now; rollBack() takes away what was added since.
  struct Mark {
    NodeId nodes = 0;
    size_t pruned = 0;
  };
  Mark mark() const { return {size(), pruned_.size()}; }
  void rollBack(const Mark& mark);
  const GraphNode& at(NodeId id) const { return nodes_[id]; }
  int size() const { return int(nodes_.size()); }
  /// Said once.
  void prune(std::string label, std::string reason, bool approximate = false);
  const std::vector<PrunedNode>& pruned() const { return pruned_; }

 private:
  std::vector<GraphNode> nodes_;
  std::vector<Hash128> structure_;  // by node
  std::unordered_map<Hash128, NodeId> byStructure_;
  std::vector<PrunedNode> pruned_;
  std::optional<std::pair<NodeId, Status>> wrong_;
};

}  // namespace terms
}  // namespace gobo

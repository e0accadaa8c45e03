// SPDX-License-Identifier: Apache-2.0
#include "terms/graph.h"

namespace gobo {
inline namespace terms {

NodeId Graph::add(GraphNode n) {
  const NodeTraits traits = n.node->traits();
  Hasher h("graph");
  h.add(n.node->type()).add(n.node->version()).add(n.node->numericClass()).add(n.blocks);
  n.node->hashParameters(h);
  h.addArray(n.inputs);
  if (traits.facets != Facet::None) {
    GOBO_CHECK(n.scene != nullptr);
    h.add(n.scene->facetHash(traits.facets, n.lights)).addArray(n.lights);
  }
  const Hash128 structure = h.digest();
  if (const auto known = byStructure_.find(structure); known != byStructure_.end()) {
    GraphNode& same = nodes_[size_t(known->second)];
    same.transient = same.transient && n.transient;
    return known->second;
  }
  std::vector<TermShape> in;
  for (NodeId input : n.inputs) {
    GOBO_CHECK_LT(input, size());
    in.push_back(at(input).shape);
  }
  Result<TermShape> shape = n.node->infer(in);
  if (shape.ok()) n.shape = n.node->afterBlocks(std::move(*shape), n.blocks);
  else if (!wrong_) wrong_.emplace(size(), shape.status().at("node " + n.label));
  nodes_.push_back(std::move(n));
  structure_.push_back(structure);
  byStructure_.emplace(structure, size() - 1);
  return size() - 1;
}

void Graph::prune(std::string label, std::string reason, bool approximate) {
  for (const PrunedNode& p : pruned_)
    if (p.label == label && p.reason == reason && p.approximate == approximate) return;
  pruned_.push_back({std::move(label), std::move(reason), approximate});
}

void Graph::rollBack(const Mark& mark) {
  for (size_t i = size_t(mark.nodes); i < structure_.size(); ++i) byStructure_.erase(structure_[i]);
  nodes_.resize(size_t(mark.nodes));
  if (wrong_ && wrong_->first >= mark.nodes) wrong_.reset();
  structure_.resize(size_t(mark.nodes));
  pruned_.resize(mark.pruned);
}

}  // namespace terms
}  // namespace gobo

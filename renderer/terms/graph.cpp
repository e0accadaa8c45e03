// SPDX-License-Identifier: Apache-2.0
#include "terms/graph.h"

namespace gobo {

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
  for (size_t i = 0; i < structure_.size(); ++i) {
    if (structure_[i] != structure) continue;
    nodes_[i].transient = nodes_[i].transient && n.transient;
    return NodeId(i);
  }
  for (NodeId input : n.inputs) GOBO_CHECK_LT(input, size());
  nodes_.push_back(std::move(n));
  structure_.push_back(structure);
  return size() - 1;
}

}  // namespace gobo

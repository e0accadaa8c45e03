// SPDX-License-Identifier: Apache-2.0
#include "plan/live_bytes.h"

#include <algorithm>
#include <unordered_set>

#include "plan/lifetimes.h"

namespace gobo {

namespace {

struct Bound {
  std::vector<uint64_t> making;  ///< by node: held while it and what it is made of are made, beside what several nodes read
  std::vector<uint64_t> own;     ///< by node: bytes that its only reader holds of it
  uint64_t always = 0;           ///< of what several read, and of small results, which keys are made of before their readers are
};

Bound boundOf(const Graph& graph, const Lifetimes& lifetimes) {
  const size_t n = size_t(graph.size());
  Bound b{std::vector<uint64_t>(n), std::vector<uint64_t>(n)};
  for (size_t id = 0; id < n; ++id) {  // inputs come before their readers
    if (lifetimes.unneeded(NodeId(id))) continue;
    const GraphNode& node = graph.at(NodeId(id));
    const uint64_t bytes = outputBytes(node);
    const bool small = node.node->traits().smallOutput;
    const bool shared = lifetimes.held(NodeId(id)) && (lifetimes.readers(NodeId(id)) > 1 || small);
    (shared ? b.always : b.own[id]) += bytes;
    const auto* fold = dynamic_cast<const FoldNode*>(node.node.get());
    const size_t fixed = fold ? size_t(fold->fixedInputs()) : node.inputs.size();
    uint64_t held = 0, step = 0;
    for (size_t i = 0; i < node.inputs.size(); ++i) {
      if (i >= fixed && (i - fixed) % size_t(fold->stride()) == 0) step = 0;
      const size_t input = size_t(node.inputs[i]);
      b.making[id] = std::max(b.making[id], held + step + b.making[input]);
      (i < fixed ? held : step) += b.own[input];
      b.making[id] = std::max(b.making[id], held + step);
    }
    b.making[id] = std::max(b.making[id], held + b.own[id]);
  }
  return b;
}

uint64_t bytesBehind(const Graph& graph, NodeId node) {
  std::unordered_set<NodeId> seen;
  std::vector<NodeId> left{node};
  uint64_t bytes = 0;
  while (!left.empty()) {
    const NodeId id = left.back();
    left.pop_back();
    if (!seen.insert(id).second) continue;
    bytes += outputBytes(graph.at(id));
    left.insert(left.end(), graph.at(id).inputs.begin(), graph.at(id).inputs.end());
  }
  return bytes;
}

}  // namespace

uint64_t mostLiveBytes(const Graph& graph, std::span<const NodeId> outputs, std::span<const NodeId> expanded) {
  Lifetimes lifetimes(graph);
  lifetimes.ask(outputs);
  const Bound bound = boundOf(graph, lifetimes);
  uint64_t most = 0, held = 0;
  for (const NodeId id : outputs) {
    most = std::max(most, held + bound.making[size_t(id)]);
    held += bound.own[size_t(id)];
  }
  most = std::max(most, held) + bound.always;
  for (const NodeId id : expanded) most = std::max(most, bytesBehind(graph, id));
  return most;
}

}  // namespace gobo

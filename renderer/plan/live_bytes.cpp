// SPDX-License-Identifier: Apache-2.0
#include "plan/live_bytes.h"

#include <algorithm>
#include <map>
#include <unordered_set>

#include "plan/lifetimes.h"

namespace gobo {
inline namespace plan {

namespace {

/// A step of a fold, and its node; of node -1: none.
struct FoldStep {
  NodeId fold = -1;
  int step = 0;
  bool operator==(const FoldStep&) const = default;
};

/// By node: the step of a fold that alone asks for it, so that it goes when the step is over. What small results are made of is asked for before, by keys.
std::vector<FoldStep> stepsOf(const Graph& graph, const Lifetimes& lifetimes, std::span<const NodeId> outputs) {
  const size_t n = size_t(graph.size());
  std::vector<FoldStep> of(n);
  std::vector<char> asked(n, 0), early(n, 0);
  for (const NodeId id : outputs) asked[size_t(id)] = 1;
  for (size_t id = n; id-- > 0;) {  // readers come before what they read
    if (lifetimes.unneeded(NodeId(id))) continue;
    const GraphNode& node = graph.at(NodeId(id));
    if (node.node->traits().smallOutput) early[id] = 1;
    if (early[id]) of[id] = {};
    const auto* fold = dynamic_cast<const FoldNode*>(node.node.get());
    for (size_t i = 0; i < node.inputs.size(); ++i) {
      const size_t input = size_t(node.inputs[i]);
      const bool stepped = fold && i >= size_t(fold->fixedInputs());
      const FoldStep reads = stepped ? FoldStep{NodeId(id), int((i - size_t(fold->fixedInputs())) / size_t(fold->stride()))} : of[id];
      if (!asked[input]) of[input] = reads;
      else if (!(of[input] == reads)) of[input] = {};
      asked[input] = 1;
      if (early[id] && !stepped) early[input] = 1;
      if (node.node->traits().smallOutput) early[input] = 1;
    }
  }
  return of;
}

struct Bound {
  std::vector<uint64_t> making;  ///< by node: held while it and what it is made of are made, beside what several nodes read
  std::vector<uint64_t> own;     ///< by node: bytes that its only reader holds of it
  uint64_t always = 0;  ///< of what several read, if not all for one step of a fold, and of small results, which keys are made of before their readers are
};

Bound boundOf(const Graph& graph, const Lifetimes& lifetimes, std::span<const NodeId> outputs) {
  const size_t n = size_t(graph.size());
  const std::vector<FoldStep> steps = stepsOf(graph, lifetimes, outputs);
  std::map<NodeId, std::vector<uint64_t>> ofSteps;  // what several nodes of a fold's step read
  Bound b{std::vector<uint64_t>(n), std::vector<uint64_t>(n)};
  for (size_t id = 0; id < n; ++id) {  // inputs come before their readers
    if (lifetimes.unneeded(NodeId(id))) continue;
    const GraphNode& node = graph.at(NodeId(id));
    const uint64_t bytes = outputBytes(node);
    const bool small = node.node->traits().smallOutput;
    const bool shared = lifetimes.held(NodeId(id)) && (lifetimes.readers(NodeId(id)) > 1 || small);
    if (const FoldStep& s = steps[id]; shared && !small && s.fold >= 0) {
      std::vector<uint64_t>& of = ofSteps[s.fold];
      of.resize(std::max(of.size(), size_t(s.step) + 1), 0);
      of[size_t(s.step)] += bytes;
    } else (shared ? b.always : b.own[id]) += bytes;
    const auto* fold = dynamic_cast<const FoldNode*>(node.node.get());
    const size_t fixed = fold ? size_t(fold->fixedInputs()) : node.inputs.size();
    uint64_t held = 0, step = 0;
    for (size_t i = 0; i < node.inputs.size(); ++i) {
      if (i >= fixed && (i - fixed) % size_t(fold->stride()) == 0) {
        const size_t at = (i - fixed) / size_t(fold->stride());
        const auto of = ofSteps.find(NodeId(id));
        step = of != ofSteps.end() && at < of->second.size() ? of->second[at] : 0;
      }
      const size_t input = size_t(node.inputs[i]);
      b.making[id] = std::max(b.making[id], held + step + b.making[input]);
      (i < fixed ? held : step) += b.own[input];
      b.making[id] = std::max(b.making[id], held + step);
    }
    if (fold) b.making[id] += node.node->workingBytes();  // from its first step on
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
  const Bound bound = boundOf(graph, lifetimes, outputs);
  uint64_t most = 0, held = 0;
  for (const NodeId id : outputs) {
    most = std::max(most, held + bound.making[size_t(id)]);
    held += bound.own[size_t(id)];
  }
  most = std::max(most, held) + bound.always;
  for (const NodeId id : expanded) most = std::max(most, bytesBehind(graph, id));
  return most;
}

}  // namespace plan
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Lifetimes: until when results of a graph's nodes are needed. A result goes when the last node that reads it is made, or was found made: what only
// a reused node reads is never asked for. A hint about memory alone: a result that goes too early is made or read again.
#pragma once

#include <span>
#include <vector>

#include "terms/graph.h"

namespace gobo {
inline namespace plan {

class Lifetimes {
 public:
  explicit Lifetimes(const Graph& graph) : graph_(graph) {}
  /// The results of these are asked for once by somebody outside.
  void ask(std::span<const NodeId> nodes);
  /// `node` is made: its inputs have one reader less. `gone(id)` for each result that nobody needs any more.
  template <class Gone>
  void made(NodeId node, Gone&& gone) {
    for (const NodeId input : graph_.at(node).inputs) read(node, input, gone);
  }
  /// One input of a node that is being made has been read (folds drop theirs step by step; made() is not for them).
  template <class Gone>
  void read(NodeId, NodeId input, Gone&& gone) {
    if (held(input) && --readers_[size_t(input)] == 0) gone(input);
  }
  /// `node` was found made: what its inputs would have been made of is not needed for it.
  template <class Gone>
  void reused(NodeId node, Gone&& gone) {
    for (const NodeId input : graph_.at(node).inputs) {
      if (!held(input)) reused(input, gone);  // was to be made for this node
      else if (--readers_[size_t(input)] == 0) {
        gone(input);
        if (!resolved_[size_t(input)]) {
          resolved_[size_t(input)] = true;
          reused(input, gone);
        }
      }
    }
  }
  void resolve(NodeId node) { resolved_[size_t(node)] = true; }
  /// Whether the result is held for all its readers: transient ones are made for each, but for small ones.
  bool held(NodeId node) const { return !graph_.at(node).transient || graph_.at(node).node->traits().smallOutput; }
  int64_t readers(NodeId node) const { return readers_[size_t(node)]; }  ///< to come
  bool unneeded(NodeId node) const { return readers(node) <= 0; }        ///< nobody will ask for it, as far as is known

 private:
  const Graph& graph_;
  std::vector<int64_t> readers_;  // reads to come, by node
  std::vector<bool> resolved_;    // made or found
};

}  // namespace plan
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "plan/lifetimes.h"

namespace gobo {
inline namespace plan {

void Lifetimes::ask(std::span<const NodeId> nodes) {
  const size_t n = size_t(graph_.size());
  readers_.assign(n, 0);
  resolved_.assign(n, false);
  std::vector<int64_t> makings(n, 0);  // how often each is made: held results once, others for each reader
  for (const NodeId id : nodes) ++readers_[size_t(id)];
  for (size_t id = n; id-- > 0;) {  // readers come after what they read
    makings[id] = held(NodeId(id)) ? (readers_[id] > 0 ? 1 : 0) : readers_[id];
    for (const NodeId input : graph_.at(NodeId(id)).inputs) readers_[size_t(input)] += makings[id];
  }
}

}  // namespace plan
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// The most bytes of results that are held at once while a plan runs, before any of it does: what admission charges. Holds whatever the store has
// of them: a result found there is not made from its inputs, but which these are, nobody knows beforehand, and a result that is made later than it
// would be with an empty store may meet more of the others. So what one node alone reads counts while that node is being made, and what several
// read counts always. A node's own working memory is not in it. O(edges).
#pragma once

#include <cstdint>
#include <span>

#include "terms/graph.h"

namespace gobo {
inline namespace plan {

/// `outputs` are held to the end; `expanded` are evaluated while planning, each by itself.
uint64_t mostLiveBytes(const Graph& graph, std::span<const NodeId> outputs, std::span<const NodeId> expanded = {});

}  // namespace plan
}  // namespace gobo

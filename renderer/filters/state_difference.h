// SPDX-License-Identifier: Apache-2.0
// A path tracing state (terms/path_trace.h) less another one of the same samples: light that is in its sums and not wanted.
#pragma once

#include "terms/node.h"

namespace gobo {
inline namespace filters {

/// Inputs: a state of `slots` slots, and one of a single slot by the same samples, whose light is part of what `slot` of the first holds. Output: the
/// first state without it, in double: what is left of light that both hold is 0 up to 1e-16 of it, and never negative. `streams`: of both states.
/// Cost: one pass, and the memory of a state.
NodePtr makeStateDifferenceNode(int width, int height, int slots, int slot, int streams);

}  // namespace filters
}  // namespace gobo

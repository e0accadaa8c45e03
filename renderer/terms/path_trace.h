// SPDX-License-Identifier: Apache-2.0
// The path tracer as an extendable source. State term "path_trace": planes "sum" f64 [pixels][slots][3] (sum over samples),
// "samples" u32 [pixels]. Result(n blocks) = fixed-order sum of blocks 0..n-1 of every pixel, whether traced at once, extended or
// resumed after a stop: pixels are independent, and each adds its blocks in order.
#pragma once

#include "terms/node.h"
#include "trace/path_tracer.h"

namespace gobo {

NodePtr makePathTraceNode(const PathTracerSettings& settings);

}  // namespace gobo

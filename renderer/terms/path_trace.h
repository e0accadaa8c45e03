// SPDX-License-Identifier: Apache-2.0
// The path tracer as an extendable source. State term "path_trace": planes "sum" f64 [pixels][slots][3] (sum over samples),
// "samples" u32 [pixels]. Its blocks, as graphs and stores count them, are the passes of trace/sample_passes.h: Result(n) = fixed-order sum of passes
// 0..n-1 of every pixel, whether traced at once, extended or resumed after a stop: pixels are independent, and each adds its passes in order.
#pragma once

#include "terms/gbuffer.h"
#include "terms/node.h"
#include "trace/path_tracer.h"
#include "trace/sample_passes.h"

namespace gobo {
inline namespace terms {

/// Streams of a state whose variance is asked for.
inline constexpr int kVarianceStreams = 8;

/// `streams` > 1: block b (of 16 samples) is block b / streams of stream b % streams (path_tracer.h: independent sequences), and the state has one more
/// plane, "streams" f32 [pixels][streams][slots][3]: the sums of each stream alone, 12 bytes a slot and stream. Their means are independent
/// estimates of the pixel, so that their scatter gives the variance of its mean without bias; the price is that the error falls with
/// the number of samples as that of `streams` shorter sequences.
/// `view`: the part of the settings' picture that is traced; of no width: all of it. `share`: of the sequence, whose other numbers are others'.
NodePtr makePathTraceNode(const PathTracerSettings& settings, int streams = 1, const GBufferSettings& view = {}, const SequenceShare& share = {});

}  // namespace terms
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Caustics of punctual lights (trace/photon_tracer.h) as an extendable source: pass i is block i. State term "caustics": planes
// "sum" f64 [pixels][slots][3] (sum over camera samples), "samples" u32 [pixels]: what makeResolveNode takes. Result(n passes) =
// fixed-order sum of passes 0..n-1 of every pixel, whether traced at once, extended or resumed after a stop. Slots: one per
// relight group, by lobe two (diffuse, specular lobe of the camera path's first event).
#pragma once

#include "terms/gbuffer.h"
#include "terms/node.h"
#include "trace/photon_tracer.h"
#include "trace/sample_passes.h"

namespace gobo {
inline namespace terms {

/// `view`: the part of the settings' picture that is made; of no width: all of it. `share`: of the pixel's sequence, where view samples take turns: a slice of
/// a shutter has its own of them.
NodePtr makeCausticsNode(const CausticSettings& settings, const GBufferSettings& view = {}, const SequenceShare& share = {});

}  // namespace terms
}  // namespace gobo

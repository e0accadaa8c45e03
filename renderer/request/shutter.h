// SPDX-License-Identifier: Apache-2.0
// Shutters: request.camera.shutter_s makes a picture the mean of slices of time (an accumulation buffer: Haeberli and Akeley 1990, "The Accumulation Buffer:
// Hardware Support for High-Quality Rendering"). Each slice is a request of its own, of the moment in its middle, with its share of the samples.
#pragma once

#include "base/status.h"
#include "gobo/v1/render.pb.h"
#include "scene/scene.h"

namespace gobo {
inline namespace request {

inline constexpr uint32_t kShutterSlices = 16;  ///< where a request does not say

inline bool hasShutter(const v1::RenderRequest& request) { return request.camera().shutter_s() > 0.0; }

/// Slices of a resolved request's picture: of few samples no more than these. 1: it is of one moment.
uint32_t shutterSlices(const v1::RenderRequest& resolved);
/// Samples of each slice of a picture of at least `samples` a pixel.
constexpr uint32_t samplesOfSlice(uint32_t samples, uint32_t slices) { return samples / slices + (samples % slices ? 1 : 0); }

/// Whether time changes anything of the scene: it has an animation, or the request has curves, or expressions that read it.
bool mayMove(const Scene& scene, const v1::RenderRequest& request);

/// Whether the camera has a lens at any time of the picture: curves may open it while the shutter is open.
bool mayHaveLens(const v1::RenderRequest& request);

/// Of a request whose curves and expressions have been applied, and are gone: its slices are said, and what changes from slice to slice of those that were
/// `asked` for is there again. Refuses what is of one moment (InvalidArgument), where the scene may move.
Status resolveShutter(v1::RenderRequest& request, const v1::RenderRequest& asked, const Scene& scene);

/// Of a request whose curves and expressions have been applied, and are gone: where output `motion` is asked for, those of `asked` that move camera or meshes
/// are there again, for they say where things were before.
void resolveMotion(v1::RenderRequest& request, const v1::RenderRequest& asked);

/// Numbers of a slice that have nothing to do with those of another slice or seed, for all but traced paths: these share the picture's own
/// (trace/sample_passes.h). The only slice has the picture's own.
uint64_t sliceSeed(uint64_t seed, uint32_t slice, uint32_t slices);
/// What slice k of a resolved request's picture is a picture of: the request without a shutter at time_s (0 if absent) + (k + 0.5) / slices shutter_s.
Result<v1::RenderRequest> sliceRequest(const v1::RenderRequest& resolved, uint32_t k);

}  // namespace request
}  // namespace gobo

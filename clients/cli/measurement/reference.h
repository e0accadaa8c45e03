// SPDX-License-Identifier: Apache-2.0
// Requests whose answers others are held against: the truth, and plain path tracing at some samples. Pure; any thread.
#pragma once

#include <string>

#include "base/status.h"
#include "gobo/v1/render.pb.h"
#include "measurement/series.h"

namespace gobo::cli {

/// How the truth of an output is made: by paths (what sums light: beauty, direct, indirect, diffuse, group:LIGHT, ...), or by shadow rays at the view samples
/// of the picture (visibility:LIGHT, whose view samples do not depend on the seed, so that what differs is the technique's error alone).
enum class TruthBy { Paths, Rays };
/// Errors: InvalidArgument: an output that has no such truth (depth, variance, negative_light, ...), naming those that do. What is no output at all is taken
/// for one of paths: the server refuses it with its list.
Result<TruthBy> truthOf(const std::string& output);
/// "scene-linear radiance" or "1": of RMSE; squared, of MSE.
const char* errorUnit(TruthBy by);

/// The same view and lights with every approximation taken out: path traced, no lights in the map's place, no denoising, no filters, no certificate; `samples`
/// a pixel, or (Rays) shadow rays a view sample, at most 4096.
v1::RenderRequest truthRequest(v1::RenderRequest request, TruthBy by, uint32_t samples, uint64_t seed);

/// A series may change how the picture is made, not what it is of: after both are made truths, and shadows, integrator and view samples left aside, they must
/// be equal. Errors: InvalidArgument naming the first field (scheme order) by which `point` is of another picture than `base`.
Status checkSameTruth(const v1::RenderRequest& base, const v1::RenderRequest& point, TruthBy by);

}  // namespace gobo::cli

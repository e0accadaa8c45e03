// SPDX-License-Identifier: Apache-2.0
// request.curves: numbers and vectors of a request over its time. A request with curves means the one that has their values at request.time_s typed in:
// they are gone once it is resolved, so keys, hashes and frames that agree in their values know nothing of them.
#pragma once

#include "base/status.h"
#include "gobo/v1/render.pb.h"

namespace gobo {
inline namespace request {

/// `width` numbers at `time`: the first key's before it, the last one's after it. SMOOTH: Fritsch, Carlson 1980, "Monotone Piecewise Cubic
/// Interpolation": monotone between keys that are, so never beyond them. Times increase, values are finite, width per time. O(log keys), SMOOTH O(1) more.
void evaluateCurve(const v1::Curve& curve, int width, double time, double* out);

/// Puts each curve's value into its field and takes the curves out. Errors: InvalidArgument at request.curves.PATH: a path that is no number or vector of
/// camera, lights, environment, shadows, tone_map or integrator, or lies in a technique that is not chosen; keys that do not fit; a value
/// out of the field's range, at whatever time.
Status applyCurves(v1::RenderRequest& request);

}  // namespace request
}  // namespace gobo

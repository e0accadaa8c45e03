// SPDX-License-Identifier: Apache-2.0
// request.filters on light: each acts on the sum of the paths that its term names, wherever that is seen: in the output of that name, in the beauty, and, if it
// is linear, in outputs that show a part of it. The beauty's own are behind its sum (plan/output_plans.cpp), those of visibility:LIGHT before light is made of
// it (techniques/direct_visibility/filtered.h).
#pragma once

#include <limits>
#include <span>
#include <string>

#include "filters/picture/chain.h"
#include "technique/path_set.h"
#include "technique/plan_context.h"

namespace gobo {
inline namespace plan {

/// Pictures of three channels, plane "rgb".
PictureShape pictureShape(int width, int height);

/// What a chain's terms may be, in this scene and for this request. Errors: InvalidArgument at "request.filters[k]" or "request.filters[k].term": no filter, no
/// such term or light, a term that is no light, a light without visibility, a filter that does not act on it, terms that overlap.
Status checkFilters(PlanContext& context);

/// Paths that filters want told apart from the rest of the beauty.
struct FilterDistinctions {
  bool classes = false, lobes = false;
};
FilterDistinctions filterDistinctions(const v1::RenderRequest& request);

struct ShownLight {
  std::string output;
  PathSet shows = PathSet::All;
  bool ofOneLight = false;
  int last = std::numeric_limits<int>::max();  ///< of request.filters on the term `output`, for one of its stages
};
/// The sum of what an output shows, denoised where the request says so, with the light that filters name behind them: plane "rgb". Errors: InvalidArgument: a
/// filter that is not linear, of a term that the output shows a part of, or that is the mean of moments.
Result<NodeId> planFilteredLight(PlanContext& context, std::span<const Contribution> shown, const ShownLight& what);

/// Where slices are denoised together there is no such part any more. Errors: InvalidArgument.
Status checkDenoisedSlices(const PlanContext& context, PathSet shows);

}  // namespace plan
}  // namespace gobo

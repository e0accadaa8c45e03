// SPDX-License-Identifier: Apache-2.0
// Styles of shadows ask for visibility to work on.
#pragma once

#include "base/status.h"
#include "gobo/v1/render.pb.h"

namespace gobo {
inline namespace request {

/// Writes out the technique of every style that stands alone: shadow rays for request.shadows; for a light's, the technique of request.shadows, or shadow rays
/// where that is path tracing. Errors: InvalidArgument, naming the field, of a style with path_traced, of a curve of another length than its transition needs,
/// and of hidden layers along surfaces.
Status resolveStyles(v1::RenderRequest& request);

}  // namespace request
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// What axis-aligned filtering did, as pictures: rays and filter widths by view sample (Wang 2013, figure 3.3).
#pragma once

#include "terms/graph.h"

namespace gobo {
inline namespace filters {

/// Adds a node "shadow_filter_maps" behind the filter that `visibility` comes from: planes rays f32, shadow rays of the view sample, and width f32, standard
/// deviation of the filter in pixels, in the light's plane; 0 where nothing is filtered. Errors: InvalidArgument where no axis-aligned filter is.
Result<NodeId> planShadowFilterMaps(Graph& graph, NodeId visibility);

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Windows: a part of a picture, planned as the picture is, with as many pixels around it as its nodes look beyond their own (NodeTraits::halo).
#pragma once

#include <span>
#include <vector>

#include "base/status.h"
#include "technique/plan_context.h"
#include "terms/graph.h"

namespace gobo {
inline namespace plan {

/// How nodes are called that cut an output out of what was made around it; the plan of a whole picture has none.
inline constexpr char kCropNode[] = "crop:";

/// request.window; of no width where the request has none. Errors: InvalidArgument.
Result<PixelWindow> windowOf(const v1::RenderRequest& request);

/// By node: whether it is of the view's pixels, a source or constant over them or a filter of what is. A map of a light may have the same size.
std::vector<bool> nodesOfView(const Graph& graph, const Extent& view);

/// Pixels beyond the view that `outputs` depend on. `view`: extent of the plan's pixel terms. Errors: InvalidArgument that names a node which reads a
/// whole picture. O(edges).
Result<int> haloOf(const Graph& graph, std::span<const NodeId> outputs, const Extent& view);

/// The window with `halo` pixels around it, as far as the picture goes.
PixelWindow grown(const PixelWindow& window, int halo, int filmWidth, int filmHeight);

}  // namespace plan
}  // namespace gobo

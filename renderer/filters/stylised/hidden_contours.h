// SPDX-License-Identifier: Apache-2.0
// Contours on surfaces that others hide (ShadowStyle.hidden_layers): further sources of a style's distance, so that a shadow reaches out from behind what
// stands in front of it (the limitation that figure 6.2 of DeCoro's thesis shows; rays through silhouettes are its remedy there).
//
// Plans        For layer k = 1 .. n "hidden_surface" behind layer k - 1 (terms/hidden_surface.h; 0 is what is seen), and its visibility by one shadow ray a
// sample to
//              the light's centre, whatever technique the request names: a map has no fit for what the camera does not see, and soft visibility would add rays
//              by the dozen for an edge that lies in the middle of its penumbra.
// Inputs       Of a distance's node, behind its own two: visibility and surface of layer 1, of layer 2, ...
// Computes     The contour of each layer as filters/stylised/contour.h has it, and the squares whose four samples lie on one surface though not in one layer,
// along
//              silhouettes of what hides it: of each sample of the first corner, in whatever layer, those of the next ones that lie on one surface with it.
//              What one layer has by itself is not counted again. So the contour of a surface that n layers hold whole is that of the surface with nothing in
//              front of it.
// Cost         Each layer a G-buffer, a ray or two a sample, a shadow ray a sample, and 56 bytes a sample; more layers than the scene is deep cost memory and
// change
//              no bit.
// Fails where  the surface goes on outside the picture, or turned away from the camera. Soft visibility in front and hard behind join along a silhouette as
// well as
//              the level's contour and the centre's shadow agree.
#pragma once

#include <vector>

#include "filters/shadow_technique.h"
#include "filters/stylised/contour.h"
#include "terms/node.h"

namespace gobo {
inline namespace filters {

/// Inputs of a distance's node behind visibility and G-buffer: 2 `layers` nodes.
std::vector<NodeId> planHiddenContours(Graph& graph, const ShadowInput& input, int layers);

/// What those are read for; their number is that of the node's inputs beyond two.
void readsHiddenContours(Wiring& w, const Extent& extent, int layers);

/// The contours' upper bound, bytes a sample of one layer of view samples, both while they are gathered and after.
inline constexpr size_t kHiddenBytes = 2 * 2 * sizeof(ContourSegment);

/// Appends to the contour of `seen` (of view samples' layer `layer`) those of what ctx.inputs has of `layers` hidden ones. Errors: Cancelled.
Status appendHiddenContours(const RunContext& ctx, const ContourInput& seen, size_t layer, int layers, float cosine, std::vector<ContourSegment>& contour);

}  // namespace filters
}  // namespace gobo

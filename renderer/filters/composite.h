// SPDX-License-Identifier: Apache-2.0
// Pixel-domain filters that put pictures together: composite (an Expression over pixel terms), shade (unoccluded light x
// visibility, averaged over view samples), resolve (mean of path-traced blocks; mean of view samples), direct fold.
// Costs: one pass over the inputs. All are linear in their radiance inputs and deterministic.
#pragma once

#include <string>
#include <vector>

#include "filters/expression.h"
#include "terms/node.h"

namespace gobo {
inline namespace filters {

/// Output: term "picture", domain Pixel, plane "rgb" (3). Expression inputs are the node's inputs, all pixel terms of one extent.
NodePtr makeCompositeNode(Expression expression, int width, int height);

/// Inputs: unoccluded term (plane "L", 3, view samples) and visibility term (plane "V", 1 or 3). Output: "direct_light", plane
/// "rgb": mean over view samples of L * V.
NodePtr makeShadeNode(int width, int height, int viewSamples);

/// Fold of shade over lights: inputs are pairs (L, V); output as shade, the sum over pairs. Memory: one double accumulator.
NodePtr makeDirectFoldNode(int width, int height, int viewSamples, int lights);

/// Input: path tracing state (terms/path_trace.h). Output: "radiance", planes "s0", "s1", ... one RGB plane a slot: the mean
/// of all samples of the state.
NodePtr makeResolveNode(int width, int height, int slots);

/// Input: a view-sample term. Output: "pixels", plane `plane`: mean over view samples. `validity` names a u32 plane of the
/// G-buffer given as second input ("" = none): samples where it is ~0u count as zero ("depth": mean over valid samples only).
NodePtr makePixelMeanNode(std::string plane, int channels, int width, int height, int viewSamples, bool overValidOnly);

/// Input: G-buffer. Output: "pixels", plane "alpha": share of view samples that hit a surface.
NodePtr makeAlphaNode(int width, int height, int viewSamples);

}  // namespace filters
}  // namespace gobo

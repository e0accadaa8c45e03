// SPDX-License-Identifier: Apache-2.0
// A picture in front of nothing.
#pragma once

#include "terms/node.h"

namespace gobo {
inline namespace filters {

/// Inputs: a picture (plane "rgb"), and a radiance term whose plane "s0" says which share of each pixel sees the background. Output: "picture", plane
/// "rgba": the light, which is not divided by alpha, and 1 - mean of the share's channels, 0..1.
NodePtr makeWithAlphaNode(int width, int height);

}  // namespace filters
}  // namespace gobo

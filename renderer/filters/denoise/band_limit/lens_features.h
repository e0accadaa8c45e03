// SPDX-License-Identifier: Apache-2.0
// Features without the noise of a lens. A view sample sees one point of the disk of confusion, so that means over few of them are noise, which edges are made
// of and which comes back where light is multiplied with its reflectance again.
#pragma once

#include "terms/direct_unoccluded.h"
#include "terms/node.h"

namespace gobo::denoise {

/// Of the disk's radius that features are averaged over (band_limit/blurred_means.h).
inline constexpr float kFeatureShare = 0.25f;

/// Inputs: features of `lobe` (features.h), lens blur (lens_blur.h). Output "lens_features": the planes of the features, averaged within the blur (position,
/// depth, footprint and alpha over what hits), but for even, which stays; and blur f32, that of the second input. About 1 ns a pixel and tap of (2
/// bandRadius(kFeatureShare) + 1)^2 and channel where all is blurred as far as it may be.
NodePtr makeLensFeaturesNode(int width, int height, LobePart lobe);

}  // namespace gobo::denoise

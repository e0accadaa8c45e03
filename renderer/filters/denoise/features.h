// SPDX-License-Identifier: Apache-2.0
// What a denoiser may know of a pixel without noise: means over its view samples.
#pragma once

#include "terms/node.h"

namespace gobo::denoise {

/// Inputs: G-buffer (terms/gbuffer.h), surface (terms/surface.h). Output: "denoise_features", planes as NoisyPicture has them (denoiser.h): albedo f32x3
/// (samples that hit nothing count as black) | normal f32x3, after normal maps | position f32x3 | depth f32 | footprint f32 | coverage f32; and modulation
/// f32x3: reflectance that light is divided by, mean albedo and what a dielectric reflects (0.04), of the view samples that hit; 1 where none does. One pass.
NodePtr makeFeaturesNode(int width, int height, int viewSamples);

}  // namespace gobo::denoise

// SPDX-License-Identifier: Apache-2.0
// What a denoiser may know of a pixel without noise: means over its view samples.
#pragma once

#include "terms/direct_unoccluded.h"
#include "terms/node.h"

namespace gobo::denoise {

/// Inputs: G-buffer (terms/gbuffer.h), surface (terms/surface.h). Output: "denoise_features", planes as NoisyPicture has them (denoiser.h): albedo f32x3
/// (samples that hit nothing count as black) | normal f32x3, after normal maps | position f32x3 | depth f32 | footprint f32 | coverage f32 | even f32: all
/// samples hit, within a pixel's width of one plane, normals (before normal maps) within 25 degrees of their mean; and modulation
/// f32x3: reflectance that light is divided by (modulationOf), mean over the view samples that hit; 1 where none does. One pass.
/// `lobe`: whose light is meant; of specular lobes there is one more plane, alpha f32: mean GGX width, 0 where a material has lobes that the surface does not
/// hold.
NodePtr makeFeaturesNode(int width, int height, int viewSamples, LobePart lobe = LobePart::Both);

/// What light of a lobe is divided by at a view sample: its reflectance head on, and 0.04. Both: albedo and what a dielectric reflects.
/// material: as in terms/surface.h.
Vec3 modulationOf(LobePart lobe, const Vec3& albedo, const float* material);

}  // namespace gobo::denoise

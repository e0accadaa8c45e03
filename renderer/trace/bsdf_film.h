// SPDX-License-Identifier: Apache-2.0
// Thin-film interference (KHR_materials_iridescence; Belcour & Barla 2017): air, film, base.
#pragma once

#include "base/vec.h"

namespace gobo {
inline namespace trace {

/// Reflectance in linear Rec.709 of a film (index >= 1, thickness in nanometres) on a base whose reflectance in air at normal
/// incidence is baseF0 per channel; c: cosine in air. Result in [0,1].
/// The extension's model with two of its approximations undone: Fresnel is exact and by polarisation (not Schlick), and the series
/// of internal reflections goes to the fourth order (not the second), so that the limit of no film is the bare base. Spectral
/// integration is the extension's: Gaussian fits of the colour matching functions, integrated in closed form; scaled per channel so
/// that a spectrum of 1 gives (1, 1, 1) (the fits as printed give equal-energy white, (1.2, 0.95, 0.91)). 130 ns.
Vec3 filmReflectance(float c, float filmIor, float thickness, const Vec3& baseF0);

}  // namespace trace
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Multiple axis-aligned filters (Wu, Yan, Kuznetsov, Ramamoorthi 2017, "Multiple axis-aligned filters for rendering of combined distribution effects"): the
// double wedge of visibility is covered by several boxes along the light's frequency instead of one. Each is a profile of the light (LightBands,
// terms/light_samples.h) of which a pixel keeps one number, summed up over its rays, and an axis-aligned filter of that number with a width of its own.
//
// Which way widths go: behind an occluder of slope s the shadow that profile l_j casts is the occluder seen by l_j, with the spectrum of l_j at light
// frequencies s Omega. A profile without high frequencies leaves none above Omega_j / s2 in the picture, and is filtered as much wider as that is lower.
// A light that ends somewhere cannot be split into bands exactly (each would reach beyond its ends, where no ray goes); the smoothest profile that is on it is
// one that falls to 0 at its ends, and what is left over is a rim.
//
// Two small filters around axis_aligned_filter:
#pragma once

#include "terms/node.h"

namespace gobo {
inline namespace filters {

/// "light_band". Input 0: "light_samples" with plane band. Plane V f32: channel `band` of it.
NodePtr makeLightBand(int band);
/// "light_band_sum". Inputs: terms with plane V f32. Plane V f32: their sum, limited to 0..1. One input: what it says, to the bit.
NodePtr makeLightBandSum();

}  // namespace filters
}  // namespace gobo

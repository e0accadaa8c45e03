// SPDX-License-Identifier: Apache-2.0
// Which shear, and how wide: the step between the pilot and the sheared filter (Yan, Mehta, Ramamoorthi, Durand 2015: slope and width of the parallelogram
// that covers the double wedge).
//
// An occluder of slope s makes visibility a function of x + s y alone (receiver x, light point y: filters/sheared/filter.h). Shared along the shear y += a D,
// a neighbour at distance D is wrong by D (1 - s a), which in standard deviations sigma s of that occluder's penumbra is D |1/s - a| / sigma: the axis-aligned
// filter is the case a = 0. So over the 1/s of the pilots around, with mean m and central moments c2 and c4, E (1/s - m)^4 stands where E 1/s^4 stands
// there; the source's middle of the wedge is the a that makes the largest |1/s - a| least. The light's ends add m^2 c2 (kEnds), because what lies there has
// neighbours on one side only, and what they are wrong by does not cancel.
#pragma once

#include "terms/light_samples.h"
#include "terms/node.h"

namespace gobo {
inline namespace filters {

struct ShadowShearSettings {
  int radiusPx = 10;    ///< window of pilots
  float sigma = 1.0f;   ///< standard deviation of the light, metres (terms/shadow_light.h)
  float half = 1.0f;    ///< the light's smaller half edge, metres
  int widestPx = 32;    ///< of the kernel
  float always = 0.0f;  ///< not 0: this many pixels of standard deviation wherever there is one slope to shear by (tests and ablation)
};

/// What a window of pilots says, in penumbra widths a pixel: z = pixel / (sigma s).
struct ShearChoice {
  float shear = 0.0f;  ///< a sigma / pixel; 0: leave the pixel to the axis-aligned filter
  float width = 0.0f;  ///< standard deviation, pixels
};
/// moments: means of z, z^2, z^3, z^4; penumbra: that of "shadow_penumbra", pixels; n rays a pixel. Whichever of both filters has the least predicted error.
ShearChoice chooseShear(const double moments[4], float penumbra, float n, const ShadowShearSettings& settings);

/// "shadow_shear". Inputs 0: "shadow_slopes", 1: "gbuffer", 2: "shadow_penumbra", 3: a term with plane n u32. Planes: shear f32 (a = 1/s), width f32 (half
/// width of the tent, metres); both 0 where the axis-aligned filter is left alone.
NodePtr makeShadowShear(const ShadowShearSettings& settings, const Extent& extent);

}  // namespace filters
}  // namespace gobo

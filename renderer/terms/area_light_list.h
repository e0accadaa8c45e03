// SPDX-License-Identifier: Apache-2.0
// Expander: the environment as N square area lights (terms/fit_area_lights.h). Term "area_light_list", domain Table, one element of
// planes over N lights; those beyond `count` are zero (the fit may find fewer). Map axes (rotation 0), map scale 1. A small output:
// passed on by content, so a map that is turned re-fits and re-plans nothing but what the turned lights touch.
//   count u32x1 | direction f32x3N towards the centres | right f32x3N tangents along the sides | angularSize f32x2N 2 tan(half angle) along
//   right and up | irradiance f32x3N on a plane facing the light, W/m^2 | remainder f32x27 ambient radiance in spherical harmonics of
//   order 2, coefficient-major (order: formulas/harmonics.glsl.h)
#pragma once

#include "terms/node.h"

namespace gobo {
inline namespace terms {

NodePtr makeAreaLightListNode(int lights);

}  // namespace terms
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// An environment map as N uniform square area lights at infinity and an ambient remainder (Annen 2008, 8.4; the thesis leaves the fit open:
// it is cited to Annen, Dong, Mertens, Bekaert, Seidel, Kautz 2008, "Real-time all-frequency shadows in dynamic scenes").
//   1. Greedy pursuit. Squares on six overlapping charts of the sphere, sides on a ladder, sums by summed-area tables: take the square with
//      the largest F^2 / (W + W0), F the flux that is left in it (luminance) and W its solid angle. W alone is the energy that
//      a constant square removes (matching pursuit); W0 blurs that measure, because shadows show flux and not detail below a few degrees: a
//      sun's aureole would take most lights. No square exceeds kSpread 4 pi / N, so that a uniform sky gets all N lights.
//   2. Joint refinement. Each light is a Gaussian on the sphere with a spread, and one background is uniform; cells go to whom they are
//      likeliest of, lights to the centre and spread of their cells, in turn (classification expectation maximisation: the likelihood
//      never falls). A small sun inside a wide sky keeps its size, which nearest-centre clustering does not do.
//   3. Moments. A light's irradiance is the flux of its cells, its direction their centre and its side the square's with their mean
//      squared distance: flux and its first and second moments are the map's. What no light holds is the remainder's mean.
// Irradiances need no least-squares fit then: flux is non-negative and adds up by construction, and a joint fit to unoccluded irradiance
// gains little while it moves flux between lights, which shadows show.
// The remainder: radiance of order 2 in spherical harmonics, the map's minus the lights' (as directions), so that unoccluded irradiance is
// right up to order 2; bands 1 and 2 are scaled down together, per channel, until its irradiance is nowhere negative (no dark
// spots where a light is in shadow). Its band 0 is what is left of the flux: the total is exact.
// Everything in double in one order: equal on any machine and thread count. Time: 0.1 to 0.3 s for 1024 x 512 texels and 45 lights.
#pragma once

#include <array>
#include <vector>

#include "base/stop.h"
#include "scene/environment.h"

namespace gobo {
inline namespace terms {

struct AreaLight {
  DVec3 direction{0, 1, 0};  ///< unit, towards its centre, map axes (rotation 0)
  DVec3 right{1, 0, 0};      ///< unit tangent: one side of the square; horizontal
  double angularSize = 0;    ///< 2 tan(half angle) of its side
  DVec3 irradiance{0.0};     ///< on a plane facing it, as a direction: its flux, W/m^2
  double solidAngle() const;
};

struct AreaLightFit {
  std::vector<AreaLight> lights;     ///< brightest first; at most as many as asked for
  std::array<DVec3, 9> remainder{};  ///< radiance, order of formulas/harmonics.glsl.h
  DVec3 flux{0.0};                   ///< of the map, W/m^2
  DVec3 remainderFlux() const;       ///< 4 pi times its mean radiance
  DVec3 remainderIrradiance(const DVec3& n) const;
};

/// `stop` is polled every few milliseconds; a fit that it ended is not to be used.
AreaLightFit fitAreaLights(const Environment& map, int lights, const StopToken& stop = {});

}  // namespace terms
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Sheared filter of shadow samples (Yan, Mehta, Ramamoorthi, Durand 2015, "Fast 4D sheared filtering for interactive rendering of distribution effects"):
// neighbours share samples one by one, each moved over the light as far as the receiver has moved.
//
// Derivation   A ray from receiver x to light point y, both planes parallel and d1 apart, crosses the plane at d2 from the light at x d2/d1 + y (1 - d2/d1), so
//              an occluder there makes visibility f a function of x + s y alone, s = d1/d2 - 1: its spectrum is a line of slope s, those of several depths a
//              double wedge. A neighbour's sample f(x', y') is then the visibility of (x, y' + a (x' - x)) with a = 1/s, exactly, and
//                V(x) = int f(x, y) l(y) dy = sum k(x' - x) f(x', y') l(y)/D(y) / sum k(x' - x) l(y)/D(y),   y = y' + a (x' - x),
//              where D(y) = sum k(x' - x) l(y - a (x' - x)) is what can reach y at all: without it the middle of the light would count more than its ends,
//              whose neighbours are on one side; and k is times the area that the pixel stands for, lest the nearer, denser side speak for one end. For the
//              tent k and the uniform rectangle l D is a product of two quadratics.
// Inputs       0: "visibility", plane V f32: the result wherever nothing is sheared; 1: "gbuffer"; 2: "light_samples" with `samples`; 3: "shadow_shear"; 4: a
//              term with plane n u32: samples of each pixel.
// Output       "visibility", plane V f32, within 0..1. A pixel for which less than kLeastTaken of the kernel could be taken (the picture's border, another
//              object, an edge), or a kernel of fewer than kLeastPixels pixels, keeps input 0, because D supposes all of it.
// Passes       Where the image's rows run along one edge of the light and its columns along the other, the sum over (x', y') falls into one over a row and
//              u and one over a column and v: 2 r + 1 pixels and their samples, then 2 r + 1 pixels and `bins` parts of the light, not (2 r + 1)^2 pixels and
//              their samples. Elsewhere a step along a row moves samples along both of the light's axes and only the whole sum is right.
// Cost         (2 r + 1)^2 n samples a pixel of some 20 flops; 16 bytes a sample of the input, 44 bytes a pixel and with passes 8 bins + 4 more.
// Fails where  several depths differ much: visibility behind two layers is a product, whose spectrum leaves the wedge of both. shear.h leaves those pixels to
//              the axis-aligned filter. Rectangles only.
// Determinism  bit-identical for any number of threads, and for tiles with a halo of radiusPx + 1 (twice that with passes).
#pragma once

#include "terms/light_samples.h"
#include "terms/node.h"

namespace gobo {
inline namespace filters {

struct ShearedFilterSettings {
  enum class Passes {
    Where,  ///< where rows and columns run along the light's edges
    Never,  ///< the whole sum everywhere (tests)
  };
  LightRectangle light;
  int radiusPx = 32;
  float angle = 0.34906585f;  ///< radians: largest between normals of pixels that share samples
  Passes passes = Passes::Where;
  int bins = 16;  ///< of the light along its second axis, between the passes
};

NodePtr makeShearedFilter(const ShearedFilterSettings& settings);

}  // namespace filters
}  // namespace gobo

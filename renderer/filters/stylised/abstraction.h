// SPDX-License-Identifier: Apache-2.0
// Abstraction of a shadow: a Gaussian over the signed distance to its contour, within the surface (DeCoro 2009, section 3; before the transfer, so that edges
// stay sharp).
//
// Computes     D'(x) = sum w D(y) / sum w,  w = exp(-|x - y|^2 / (2 sigma^2)) dA(y)  over samples y within 3 sigma in the world whose normals differ by at most
// `angle`
//              and that have a distance (|D| < 1e30); dA(y) the area of the surface that sample y stands for. x itself always counts. Samples are taken at the
//              picture's raster, every sigma/3 of it (of the width of a pixel at x) and at least every twelfth of its longer side: the trapezoid rule, exact
//              for a Gaussian. A sigma far beyond the picture gives the mean over the surface.
// Effect       Straight edges stay where they are. A disc of radius R shrinks to about R - sigma^2 / (2 R) and is gone at sigma = R sqrt(2/pi) with the
// Euclidean distance, so
//              small shadows vanish; a contour that waves with wave number k keeps exp(-sigma^2 k^2 / 2) of its amplitude.
// Inputs       0: plane D (filters/stylised/distance_field.h); 1: "gbuffer" (P, N, Ng, instance, footprint); 2, where sigma varies: "style_parameters" (plane
//              abstraction: sigma of each sample x; where it is 0 D' = D).
// Output       term "style_distance", plane D. sigma = 0 copies.
// Cost         By cells where a surface is smooth and sigma is 3.6 pixels and more, the same everywhere (filters/stylised/abstraction_cells.h): some 6 to 90
//              sums a sample. Elsewhere a disc in at most 37 x 37 samples, in 19 x 19 to 25 x 25 for a sigma of more than 6 pixels, about 1 ns each.
// Error        Cut at 3 sigma: 1.1 % of the weight, width 0.974 sigma. By cells 0.2 % of sigma at a ridge of D.
// Fails where  surfaces are seen under less than some 20 degrees: samples are farther apart than sigma; near the picture's border one side is missing.
// Determinism  bit-identical for any number of threads. No windows: how many pixels 3 sigma are depends on the picture.
#pragma once

#include "terms/node.h"

namespace gobo {
inline namespace filters {

struct StyleAbstractionSettings {
  Extent extent;
  float sigma = 0;            ///< scene units; not asked where it varies
  float angle = 0.78539816f;  ///< radians
  bool varies = false;
  float pixel = 0;  ///< above 0: over the picture, with pixels of that width (filters/stylised/screen_metric.h); 0: in the world
};

NodePtr makeStyleAbstractionNode(const StyleAbstractionSettings& settings);

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Signed averaged distance by points of the contour that are drawn at random for each pixel: the published estimate of the distance field (DeCoro 2009,
// section 3.3; ShadowStyle.samples), with its dial of time against noise. filters/stylised/distance_field.h has the same by all of the contour.
//
// Computes     With A' the mean of |x - y|^-p over N points y of the layer's contour (filters/stylised/sampled_sums.h), L the contour's length and m of the N
// points seen:
//              LOCAL D = (A' L / c_p)^(-1/(p-1)), PUBLISHED D = (A' N / m)^(-1/p); signs as there.
// Inputs, output, parameters   those of "style_distance"; samples 1 .. 65536; seed; place: points are drawn by the pixel's place in the whole picture.
// Error        For a straight contour of length L at distance d, where N d / L is 10 or more: relative standard deviation (1/p) sqrt(kappa / N), kappa = L c_2p
// / (c_p^2 d) - 1 (LOCAL: 1/(p-1) in the place
//              of 1/p), and a bias of (1/p)(1 + 1/p) kappa / (2 N), always towards far: the root of a mean. Where N d / L is about 1 or less the error is as
//              large as D. No bound.
// Fails where  a pixel is near the contour: points are missed, D is too large by any factor, and its sign alone is right. With a guard, where all of few points
// are turned away:
//              +-1e30, though some of the contour is seen.
// Cost         Contour by the layer, then N times some 20 ns a view sample: docs/intent.md has a table beside the exact field, which costs what 16 points do.
// Determinism  bit-identical for any number of threads. No windows: the contour is that of the picture.
#pragma once

#include "filters/stylised/distance_field.h"
#include "terms/view_place.h"

namespace gobo {
inline namespace filters {

struct SampledDistanceSettings {
  StyleDistanceSettings distance;
  uint32_t samples = 1024;
  uint64_t seed = 0;
  ViewPlace place;
};

NodePtr makeSampledDistanceNode(const SampledDistanceSettings& settings);

}  // namespace filters
}  // namespace gobo

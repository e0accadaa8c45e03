// SPDX-License-Identifier: Apache-2.0
// Picture-quality metrics on display-mapped pictures (measure/display.h). Both pictures must have the same size (CHECKed).
// Pure functions; any thread; float64 inside.
#pragma once

#include <vector>

#include "base/image.h"

namespace gobo {
inline namespace measure {

/// Mean structural similarity (Wang, Bovik, Sheikh, Simoncelli, IEEE TIP 13(4), 2004): luma, 11 x 11 Gaussian window of
/// sigma 1.5, K1 = 0.01, K2 = 0.03, L = 1, averaged over the positions whose window lies inside. Pictures below 11 pixels on
/// a side get one window, the whole picture with equal weights. 1 = identical. Cost: 110 multiply-adds a pixel.
double structuralSimilarity(const Image& a, const Image& b);

/// Pixels per degree of the FLIP paper's standard observer: a 0.7 m wide 3840 pixel monitor seen from 0.7 m, about 67.02.
double flipPixelsPerDegree();
/// LDR-FLIP per pixel (Andersson, Nilsson, Akenine-Moller, Oskarsson, Astrom, Fairchild: FLIP, A Difference Evaluator for
/// Alternating Images, HPG 2020), 0..1, row by row. Symmetric in its arguments. All of the paper's constants; the 2D filters
/// are applied as sums of separable ones, which is the same up to rounding. Edges are replicated. About 1 us a pixel.
std::vector<double> flipMap(const Image& reference, const Image& test, double pixelsPerDegree);

}  // namespace measure
}  // namespace gobo

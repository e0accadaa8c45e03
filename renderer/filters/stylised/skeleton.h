// SPDX-License-Identifier: Apache-2.0
// Skeleton of a shadow on the raster: samples from which it is as wide as it is, so that nothing of it comes apart along them.
//
// Computes     r(x), the distance in the world from a shadowed sample (D < 0) to the nearest place where D is 0 between two samples of one surface; then the
//              samples of the skeleton, with r > 0, all others having 0. Anchors are neighbours from whose middle the nearest places of the two lie at least
//              120 degrees apart: the middle of parts with nearly parallel sides. The rest is taken away from the outside in, by increasing r, where that
//              changes neither connections nor holes (simple points; ordered homotopic thinning, Pudney 1998), so that anchors stay connected as the shadow is.
// Connected    Shadow by eight neighbours, light by four, as the contour has it (filters/stylised/contour.h), both by surface links
//              (filters/stylised/surface_links.h).
// Left out     Corners: a right one has 90 degrees, so deflation takes it back as it does without a skeleton. Anchors of r < 3/4 of a pixel: bumps of one pixel
//              are no parts, and lines of one pixel keep their connections but not their ends. Shadow that no contour bounds has no r.
// Cost         30 to 60 ns a sample for r, some 200 ns a shadowed one for thinning, on one thread a layer.
// Determinism  sequential: by r, then by place.
#pragma once

#include "filters/stylised/surface_links.h"

namespace gobo {
inline namespace filters {

/// Of one layer. `D`, `r`: width * height. Errors: Cancelled.
Status shadowSkeleton(const ContourInput& in, const SurfaceLinks& links, std::span<const float> D, std::span<float> r, const StopToken& stop);

/// Whether a pixel may change sides without changing connections: bits of shadowed neighbours as in kAround, shadow connected by eight, light by four.
bool isSimplePoint(uint8_t shadowed);

}  // namespace filters
}  // namespace gobo

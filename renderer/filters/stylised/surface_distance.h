// SPDX-License-Identifier: Apache-2.0
// Signed distance to the contour of a shadow along the surfaces that are seen (ShadowStyle.metric: SURFACE): what stands in the place of
// filters/stylised/distance_field.h where lengths are those of a walk over the receivers. The "averaged graph distance" that DeCoro's thesis names as future
// work (section 3.6), as a geodesic one; there is no average in it: power, norm and samples do not count.
//
// Computes     |D| of filters/stylised/surface_march.h against the contour of its layer, negative in shadow. From a floor up a wall it is the way to the corner
// and
//              the way up; around a gap or a hole the way around; between things that only overlap in the picture there is none.
// Inputs       0: a visibility term, plane V (1 or 3 channels), hard at 1/2 or at the middle of one of `levels` steps. 1: "gbuffer".
// Output       term "style_distance", domain ViewSample, plane D f32 in scene units: never 0; +-1e30 where no contour can be reached, +1e30 where nothing is
// hit. Parameters   angle 0 .. pi: of the contour, and of bends that count as flat for samples far apart; level, levels. Fails where  a surface goes on behind
// something, or outside the picture: nothing is known of it there, and the way around is longer than it is. Where D's fronts
//              meet it has ridges, as any shortest distance has; abstraction smooths them.
// Cost         About 3 us a view sample, layers side by side; see there. Two segments a square are the bound of what it holds.
// Determinism  bit-identical for any number of threads. No windows: D is of the whole picture.
#pragma once

#include "filters/stylised/distance_field.h"

namespace gobo {
inline namespace filters {

/// Of the settings extent, angle, level and levels count.
NodePtr makeSurfaceDistanceNode(const StyleDistanceSettings& settings);

}  // namespace filters
}  // namespace gobo

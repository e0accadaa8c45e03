// SPDX-License-Identifier: Apache-2.0
// Numbers of a style by formulas, one for each view sample.
//
// Computes     Each formula at each view sample that hits something, limited to the range of its field.
// Inputs       0: "gbuffer"; then, where any formula reads `distance` or a caster, "style_occluder" (filters/stylised/edge_mean.h); then, where any reads
// `edge`, a
//              "style_distance" (plane D).
// Output       term "style_parameters", domain ViewSample, a plane f32 by the name of each field; 0 where nothing is hit.
// Errors       InvalidArgument at the formula: not a number at some sample, which is named with what it read (the first one, whatever the number of threads).
// Cost         some 20 to 100 ns a formula and sample.
#pragma once

#include "filters/stylised/style_formulas.h"
#include "terms/node.h"
#include "terms/view_place.h"

namespace gobo {
inline namespace filters {

/// Abstraction reads no edge and is made before it: the caller plans it apart from the others. `formulas` is not empty. `place`: of the view, by which errors
/// name pixels of the picture (those of a guard around it are below 0 or beyond its size).
NodePtr makeStyleParametersNode(const Extent& extent, StyleFormulaList formulas, double time, const ViewPlace& place = {});

}  // namespace filters
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Smoothing by the umbrella operator: a point moves to the mean of its neighbours by a share. A wave of eigenvalue k of the graph's Laplacian (k from 0,
// a translation, to at most 2, neighbours that alternate) is multiplied by (1 - step k) a pass; Taubin (1995) adds a step out of
// step / (1 - kPassBand step), which multiplies by 1 + that times k: waves below kPassBand keep their size (they grow by at most 0.07 % a pass at step
// 0.5), those above decay. Up to kLargestTaubinStep no wave of k <= 2 grows by that.
#pragma once

#include "scene/mesh_filters/weld.h"

namespace gobo {
inline namespace scene {

inline constexpr double kPassBand = 0.1;

/// Passes over all points at once (Jacobi): the order of points does not matter but for rounding. `out`: the second step of each pass, 0: none
/// (Laplacian). Points without neighbours stay. O(edges) a pass. False after `stop`.
bool smoothPoints(std::vector<DVec3>& points, const PointGraph& graph, uint32_t passes, double step, double out, const StopToken& stop);

/// Taubin's step out for a step in: 1 / step + 1 / -out = kPassBand.
constexpr double taubinStepOut(double step) { return step / (1.0 - kPassBand * step); }

}  // namespace scene
}  // namespace gobo

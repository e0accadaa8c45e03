// SPDX-License-Identifier: Apache-2.0
// The loops of the averaged distance over one patch of at most 64 points: sums over its sources in units of each point's own nearest distance.
#pragma once

#include "filters/stylised/contour_tree.h"

namespace gobo {

inline constexpr size_t kPatchPoints = 64;

struct PatchPoints {
  double x[kPatchPoints], y[kPatchPoints], z[kPatchPoints];
  double nearest2[kPatchPoints];  ///< square of the nearest distance so far
  double sum[kPatchPoints];       ///< integral of (r / nearest)^-p
  size_t count = 0;
};

/// nearest2 = min(nearest2, squared distances to the sources).
void nearestSources(const std::vector<PatchSources::Source>& sources, PatchPoints& points);
/// sum += what the sources give; nearest2 > 0.
void addSources(const std::vector<PatchSources::Source>& sources, int p, PatchPoints& points);

}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// The loops of the averaged distance over one patch of at most 64 points: sums over its sources in units of each point's own nearest distance.
// In float, about the patch's centre and in units of its nearest source: far and near scales of a scene do not meet in one number, and some hundred positive
// terms add up to 1e-6.
#pragma once

#include "filters/stylised/contour_tree.h"

namespace gobo {

inline constexpr size_t kPatchPoints = 64;

struct PatchPoints {
  float x[kPatchPoints], y[kPatchPoints], z[kPatchPoints];  ///< from the patch's centre, in units
  float nearest2[kPatchPoints];                             ///< square of the nearest distance so far, in units
  float sum[kPatchPoints];                                  ///< integral of (r / nearest)^-p, in units
};

/// A source about the patch's centre, in units.
struct PatchSource {
  float x, y, z, length;
  float moment[6];
  bool point;
};
PatchSource patchSource(const PatchSources::Source& source, const DVec3& centre, double unit);

/// nearest2 = min(nearest2, squared distances to the sources).
void nearestSources(const std::vector<PatchSource>& sources, PatchPoints& points);
/// sum += what the sources give; nearest2 > 0.
void addSources(const std::vector<PatchSource>& sources, int p, PatchPoints& points);

}  // namespace gobo

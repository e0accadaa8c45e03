// SPDX-License-Identifier: Apache-2.0
// Kernel widths of soft shadows from one depth map (Fernando 2005; Annen 2008, 8.2 and 8.3). Depths are metric and planar, from the
// light; widths are in window units of the map: tangents when perspective, metres when orthographic.
#ifndef GOBO_FORMULAS_SOFT_SHADOW
#define GOBO_FORMULAS_SOFT_SHADOW
#include "formulas/shadow_map.glsl.h"
FORMULAS_BEGIN

/// Width on the map of the cone from a receiver at depth d to a light of width `size` (orthographic: 2 tan of half its angle), cut at
/// depth z: size (d - z) / (d z). Eq. 8.10 and the search kernel of 8.2.2 alike (the near plane cancels). 0 for z >= d.
FORMULA float softWidth(float d, float z, float size, bool perspective) {
  float gap = maxOf(d - z, 0.0f);
  float w = CHOOSE(perspective, size * gap / maxOf(d * z, 1.0e-12f), size * gap);
  return minOf(finiteOr(w, 0.0f), 1.0e6f);
}

/// Average blocker depth from means over one kernel: z of everything, z of what lies behind or at the receiver, and the visible share:
/// (E[z] - E[z lit]) / (1 - s); `fallback` where nothing blocks.
FORMULA float softBlocker(float blockedSum, float blockedShare, float lo, float hi, float fallback) {
  float z = blockedSum / maxOf(blockedShare, 1.0e-6f);
  return CHOOSE(blockedShare > 1.0e-6f, limit(finiteOr(z, fallback), lo, hi), fallback);
}

/// Contact sharpening s^(1 + A e^{-B (d - z)}) (eq. 8.9), gap = d - z >= 0 in depth ranges.
FORMULA float softSharpen(float s, float gap, float a, float b) {
  float p = 1.0f + a * fastExp(-b * maxOf(gap, 0.0f));
  return CHOOSE(s <= 0.0f, 0.0f, limit(fastExp(p * fastLog(maxOf(s, 1.0e-30f))), 0.0f, 1.0f));
}

FORMULAS_END
#endif

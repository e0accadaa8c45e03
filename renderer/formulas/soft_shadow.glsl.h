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

/// How far a point at map offset t (tangents from the centre) sees a sphere widened along one axis of a map that is not square to it: the
/// disk it shows lies across the direction (t, 1), so that its image in the map is longer by sqrt(1 + t^2) along that axis.
FORMULA float softStretch(float t) { return sqrtOf(1.0f + t * t); }

/// Height above the receiver's plane of a texel at offset (x, y) texels with linear depth z, metres: (a + ax x + ay y) + z (b + bx x + by y).
/// Exact for perspective and orthographic maps: both are linear in z for a fixed texel.
FORMULA float softHeight(float a, float ax, float ay, float b, float bx, float by, float x, float y, float z) {
  return (a + (ax * x + ay * y)) + z * (b + (bx * x + by * y));
}

/// Does a texel block a receiver? It must lie nearer to the light than it, and above its plane: what lies below the plane cannot come
/// between it and any point of a light above it. (Digest 7.10: receivers tilted to the map do not shade themselves, however wide the kernel.)
FORMULA float softBlocks(float z, float d, float height, float margin) { return CHOOSE((z < d) && (height > margin), 1.0f, 0.0f); }

/// Does a texel at offset x along an axis of the map touch the cone from the receiver (metric depth d) to the light, where it is cut at the texel's own
/// depth z? `scale`: texels per unit of softWidth(d, z, 1).
FORMULA bool softInside(float x, float d, float z, float scale, bool perspective) {
  float q = CHOOSE(perspective, d * z, 1.0f);
  return (2.0f * absOf(x) - 1.0f) * q <= scale * (d - z);
}

/// Share of a light above a plane: `height` of its centre and half its extent along the plane's normal, as if its points were spread evenly in between.
FORMULA float softAbove(float height, float half_) { return limit(0.5f + 0.5f * finiteOr(height / maxOf(half_, 1.0e-20f), 1.0f), 0.0f, 1.0f); }

/// Visibility from the blocked share of the whole light, of which the share `above` is above the horizon.
FORMULA float softVisibility(float blocked, float above) { return limit(1.0f - blocked / maxOf(above, 1.0e-3f), 0.0f, 1.0f); }

/// 0 where at most `lo` of the search kernel is blocked, 1 from `hi` on (smooth: a hard threshold draws a line around penumbras).
FORMULA float softGate(float blocked, float lo, float hi) {
  float t = limit((blocked - lo) / (hi - lo), 0.0f, 1.0f);
  return t * t * (3.0f - 2.0f * t);
}

/// Blocked share p of a kernel whose blockers read as `full` instead of 1 and whose rest reads as `self` instead of 0: measured = p full +
/// (1 - p) self. What a truncated series makes of blockers close to the receiver, and of the receiver's own plane, is taken out.
FORMULA float softUnmix(float measured, float self, float full) { return (measured - self) / maxOf(full - self, 0.1f); }

/// sin(x) / x, and its derivative.
FORMULA float softSinc(float x) { return CHOOSE(absOf(x) < 1.0e-2f, 1.0f - x * x * (1.0f / 6.0f), fastSin(x) / nonzero(x)); }
FORMULA float softSincSlope(float x) { return CHOOSE(absOf(x) < 5.0e-2f, -x * (1.0f / 3.0f), (fastCos(x) - softSinc(x)) / nonzero(x)); }

/// Variance soft shadow maps (Yang et al. 2010, eq. 5): sum of the blockers' depths, per kernel, where the rest lies at the receiver.
FORMULA float softVarianceBlocked(float mean, float visible, float d) { return mean - visible * d; }

/// Level of a mip chain whose trilinear footprint has the variance of a box of `width` texels: a tent over box texels of side L has
/// L^2 (1/6 + 1/12), the box width^2 / 12.
FORMULA float softLevel(float width) { return fastLog(maxOf(width * 0.577350269f, 1.0f)) * 1.44269504088896341f; }

FORMULAS_END
#endif

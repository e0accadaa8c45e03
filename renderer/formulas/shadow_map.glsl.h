// SPDX-License-Identifier: Apache-2.0
// What all shadow maps share: where a receiver falls in the map, how far it may lie behind its texel, bilinear means, the test.
// z, d: linear planar depth, 0 at the light's near plane, 1 at its far plane (Annen 2008, 3.2.2). Each function is finite for
// every input.
#ifndef GOBO_FORMULAS_SHADOW_MAP
#define GOBO_FORMULAS_SHADOW_MAP
#include "formulas/math.glsl.h"
FORMULAS_BEGIN

/// One row of the light's affine map: a . (p) + b, p relative to the frame's origin.
FORMULA float shadowRow(float ax, float ay, float az, float b, float px, float py, float pz) {
  PRECISE float s = ((ax * px + ay * py) + az * pz) + b;
  return s;
}

/// 1 / w where the point lies in front of the light (w > 0), else 0.
FORMULA float shadowInverse(float w) { return CHOOSE(finiteOr(w, -1.0f) > 1.0e-20f, 1.0f / maxOf(w, 1.0e-20f), 0.0f); }

/// Is the map coordinate covered? A NaN is not.
FORMULA bool shadowCovered(float u, float v, float inverseW) { return (u >= 0.0f) && (u <= 1.0f) && (v >= 0.0f) && (v <= 1.0f) && (inverseW > 0.0f); }

/// Texel position of coordinate u on an axis of `size` texels, limited to the centres of the first and the last one.
FORMULA float shadowTexel(float u, float size) {
  PRECISE float t = limit(finiteOr(u, 0.0f), 0.0f, 1.0f) * size - 0.5f;
  return limit(t, 0.0f, size - 1.0f);
}

/// Bilinear mean of four texels.
FORMULA float shadowBilinear(float e00, float e10, float e01, float e11, float fx, float fy) {
  PRECISE float top = e00 * (1.0f - fx) + e10 * fx;
  PRECISE float bottom = e01 * (1.0f - fx) + e11 * fx;
  PRECISE float e = top * (1.0f - fy) + bottom * fy;
  return e;
}

/// A depth of the map; one that is not finite counts as "nothing hit" (z = 1), so that no filter can spread it.
FORMULA float shadowDepth(float z) { return limit(finiteOr(z, 1.0f), 0.0f, 1.0f); }
/// A receiver's depth; one that is not finite is lit (d = 0), one beyond the far plane lies on it.
FORMULA float shadowReceiver(float d) { return limit(finiteOr(d, 0.0f), 0.0f, 1.0f); }

/// Williams 1978: 1 lit, 0 shadowed; a tie is lit.
FORMULA float shadowTest(float d, float z) { return CHOOSE(d <= z, 1.0f, 0.0f); }

/// Change of a plane's depth from one texel to the next along one axis of the map. The plane has normal n through the receiver;
/// nAxis = n . axis, nRay = n . (forward + x right + y up) (perspective) or n . forward, z: metric planar depth (perspective) or 1,
/// scale: window units a texel over the metric depth range. Limited to +-1 range a texel: planes seen edge-on have no bound.
FORMULA float shadowSlope(float nAxis, float nRay, float z, float scale) {
  float steep = CHOOSE(nRay < 0.0f, minOf(nRay, -1.0e-4f), maxOf(nRay, 1.0e-4f));
  return limit(finiteOr(-z * nAxis / steep * scale, 0.0f), -1.0f, 1.0f);
}

/// Light bleeding reduction: visibility below `cut` is dark, the rest stretched to [0,1] (Lauritzen 2007). cut < 1.
FORMULA float shadowStretch(float s, float cut) { return limit((s - cut) / (1.0f - cut), 0.0f, 1.0f); }

FORMULAS_END
#endif

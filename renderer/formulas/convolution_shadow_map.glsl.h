// SPDX-License-Identifier: Apache-2.0
// Convolution shadow maps (Annen, Mertens, Bekaert, Seidel, Kautz 2007; thesis eq. 6.5): the shadow test as a Fourier series
//   f(d, z) = 1/2 + 2 sum_k (1/c_k) [cos(c_k d) sin(c_k z) - sin(c_k d) cos(c_k z)],  c_k = pi (2 k - 1) / P, k = 1..M.
// The square wave that it follows steps down again at |z - d| = P; P = 1 + 1/M keeps that beyond every pair of depths in [0,1]
// and every offset used here (the thesis has P = 1, which darkens what lies far behind and lights what lies far in front).
#ifndef GOBO_FORMULAS_CONVOLUTION_SHADOW_MAP
#define GOBO_FORMULAS_CONVOLUTION_SHADOW_MAP
#include "formulas/shadow_map.glsl.h"
FORMULAS_BEGIN

FORMULA float csmPeriod(float order) { return 1.0f + 1.0f / order; }
/// c_1 z: the angle of the first term; the k-th has (2 k - 1) times it.
FORMULA float csmAngle(float z, float order) { return 3.14159265358979f * z / csmPeriod(order); }
/// Weight of term k: 2 P^-1 P / (pi (2 k - 1)), attenuated by exp(-alpha (k/M)^2).
FORMULA float csmWeight(float k, float order, float attenuation) {
  float r = k / order;
  return 0.636619772367581f / (2.0f * k - 1.0f) * fastExp(-attenuation * (r * r));
}
/// Chebyshev step of sin((2 k + 1) x) from the two before it; twoCos2 = 2 cos(2 x). The same for cos.
FORMULA float csmNext(float current, float before, float twoCos2) {
  PRECISE float next = twoCos2 * current - before;
  return next;
}
/// Term k of the series: weight (cos(c_k d) S - sin(c_k d) C), S and C the filtered sine and cosine image.
FORMULA float csmTerm(float weight, float sinD, float cosD, float sineImage, float cosineImage) {
  PRECISE float t = weight * (cosD * sineImage - sinD * cosineImage);
  return t;
}
/// Byte form of a basis value in [-1,1]: the nearest of 255 steps that have an exact zero.
FORMULA float csmToByte(float b) { return floorOf(limit(b, -1.0f, 1.0f) * 127.0f + 127.5f); }
FORMULA float csmFromByte(float q) { return (q - 127.0f) * (1.0f / 127.0f); }

FORMULAS_END
#endif

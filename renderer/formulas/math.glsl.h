// SPDX-License-Identifier: Apache-2.0
// Elementary functions of float with stated error, the same text on every device, branch-free: loops over them vectorise
// (std::exp does not) and two devices agree. Errors below are the largest seen against double over dense sweeps of the
// stated range (tests/unit/device/formulas_test.cpp holds them). Every function gives a finite value for every input,
// NaN and infinities included. Polynomials: Cephes (S. Moshier), single precision; reductions: Cody & Waite.
#ifndef GOBO_FORMULAS_MATH
#define GOBO_FORMULAS_MATH
#include "formulas/formulas.h"
FORMULAS_BEGIN

/// x, or `fallback` where x is NaN or infinite. Reads the bits, so that no fast-math mode can drop it.
FORMULA float finiteOr(float x, float fallback) { return CHOOSE((bitsOf(x) & 0x7f800000) != 0x7f800000, x, fallback); }

/// Finite x limited to [lo, hi].
FORMULA float limit(float x, float lo, float hi) { return minOf(maxOf(x, lo), hi); }

/// x moved away from zero, to keep its reciprocal finite.
FORMULA float nonzero(float x) { return CHOOSE(x < 0.0f, minOf(x, -1.0e-30f), maxOf(x, 1.0e-30f)); }

/// e^r for |r| <= ln(2)/2.
FORMULA float expCore(float r) {
  PRECISE float p = 1.9875691500e-4f;
  p = p * r + 1.3981999507e-3f;
  p = p * r + 8.3334519073e-3f;
  p = p * r + 4.1665795894e-2f;
  p = p * r + 1.6666665459e-1f;
  p = p * r + 5.0000001201e-1f;
  PRECISE float e = (p * (r * r) + r) + 1.0f;
  return e;
}

/// e^x within 1 ulp for x in [-87.33, 88.37]; beyond, the value at the nearer end (1.2e-38 or 2.4e38: never 0, never
/// infinite). NaN gives 1.
FORMULA float fastExp(float x) {
  float y = limit(CHOOSE(x == x, x, 0.0f), -87.33f, 88.37f);
  float n = floorOf(y * 1.44269504088896341f + 0.5f);
  PRECISE float r = (y - n * 0.693359375f) - n * -2.12194440e-4f;
  return expCore(r) * floatOf((int(n) + 127) << 23);
}

/// 2^x within 1 ulp, exact for whole x. x must be finite and in [-126, 127]: for arguments that are limited already.
FORMULA float exp2InRange(float x) {
  float n = floorOf(x + 0.5f);
  PRECISE float r = (x - n) * 0.693147180559945f;
  return expCore(r) * floatOf((int(n) + 127) << 23);
}

/// The same for any x: beyond the range the value at the nearer end, NaN gives 1.
FORMULA float fastExp2(float x) { return exp2InRange(limit(CHOOSE(x == x, x, 0.0f), -126.0f, 127.0f)); }

/// ln(x) within 1 ulp for normal x > 0; below the smallest normal (1.18e-38), negative or not finite: its value there, -87.34.
FORMULA float fastLog(float x) {
  float y = maxOf(finiteOr(x, 0.0f), 1.17549435e-38f);
  int e = (bitsOf(y) - 0x3f3504f3) >> 23;  // m in [sqrt(1/2), sqrt(2))
  float m = floatOf(bitsOf(y) - (e << 23));
  float n = float(e);
  float f = m - 1.0f;
  PRECISE float z = f * f;
  PRECISE float p = 7.0376836292e-2f;
  p = p * f - 1.1514610310e-1f;
  p = p * f + 1.1676998740e-1f;
  p = p * f - 1.2420140846e-1f;
  p = p * f + 1.4249322787e-1f;
  p = p * f - 1.6668057665e-1f;
  p = p * f + 2.0000714765e-1f;
  p = p * f - 2.4999993993e-1f;
  p = p * f + 3.3333331174e-1f;
  PRECISE float t = (f * z) * p;
  t = t + n * -2.12194440e-4f;
  t = t - 0.5f * z;
  t = f + t;
  t = t + n * 0.693359375f;
  return t;
}

/// sin(x + quarter * pi/2), |x| <= 8192 (limited to it): shared by fastSin and fastCos.
FORMULA float sinQuarter(float x, int quarter) {
  float y = limit(finiteOr(x, 0.0f), -8192.0f, 8192.0f);
  float n = floorOf(y * 0.636619772367581343f + 0.5f);
  PRECISE float r = ((y - n * 1.5703125f) - n * 4.837512969970703125e-4f) - n * 7.549789948768648e-8f;
  PRECISE float z = r * r;
  PRECISE float s = -1.9515295891e-4f;
  s = s * z + 8.3321608736e-3f;
  s = s * z - 1.6666654611e-1f;
  s = (s * z) * r + r;
  PRECISE float c = 2.443315711809948e-5f;
  c = c * z - 1.388731625493765e-3f;
  c = c * z + 4.166664568298827e-2f;
  c = (c * z) * z - 0.5f * z;
  c = c + 1.0f;
  int q = int(n) + quarter;
  float v = CHOOSE((q & 1) != 0, c, s);
  return CHOOSE((q & 2) != 0, -v, v);
}

/// Within 1e-7 absolute for |x| <= 8192, and 1.2 ulp for |x| <= pi/2; |x| beyond is read as 8192.
FORMULA float fastSin(float x) { return sinQuarter(x, 0); }
FORMULA float fastCos(float x) { return sinQuarter(x, 1); }

FORMULAS_END
#endif

// SPDX-License-Identifier: Apache-2.0
// Real spherical harmonics of order 2 and the irradiance that they give (Ramamoorthi & Hanrahan 2001, "An efficient representation for
// irradiance environment maps"): E(n) = sum_l A_l sum_m L_lm Y_lm(n) with A = pi, 2 pi / 3, pi / 4. Coefficients in the order
// 00, 1-1, 10, 11, 2-2, 2-1, 20, 21, 22, that is 1, y, z, x, xy, yz, 3 z^2 - 1, xz, x^2 - y^2.
#ifndef GOBO_FORMULAS_HARMONICS
#define GOBO_FORMULAS_HARMONICS
#include "formulas/formulas.h"
FORMULAS_BEGIN

/// The linear part of E(n), without A_0 L_00 Y_00.
FORMULA float harmonicIrradiance1(float x, float y, float z, float c1, float c2, float c3) { return 1.02332670794649f * (c1 * y + c2 * z + c3 * x); }
/// Its quadratic part.
FORMULA float harmonicIrradiance2(float x, float y, float z, float c4, float c5, float c6, float c7, float c8) {
  return 0.858085530825384f * (c4 * (x * y) + c5 * (y * z) + c7 * (x * z)) + 0.247707956101846f * c6 * (3.0f * z * z - 1.0f) +
         0.429042765412692f * c8 * (x * x - y * y);
}
/// Its mean over all n.
FORMULA float harmonicIrradiance0(float c0) { return 0.886226925452758f * c0; }

FORMULAS_END
#endif

// SPDX-License-Identifier: Apache-2.0
// What a thin lens makes of a point: a disk on the film (Cook, Porter and Carpenter 1984).
// Common subset of C++ and GLSL: pure functions of floats, no branches.
#ifndef GOBO_FORMULAS_LENS
#define GOBO_FORMULAS_LENS

#include "formulas/formulas.h"
FORMULAS_BEGIN

/// Radius of the disk, in the unit of `focal`, of a point at distance 1 / perDistance along the axis (0: infinitely far). radius: of the lens, metres;
/// focus: distance of the plane that is sharp, metres; focal: of the picture at distance 1, pixels.
FORMULA float lensConfusion(float radius, float focus, float focal, float perDistance) { return radius * focal * absOf(1.0f / focus - perDistance); }

/// Of a telecentric lens (orthographic cameras): `scale` pixels a metre, a point `distance` metres along the axis.
FORMULA float lensConfusionTelecentric(float radius, float focus, float scale, float distance) { return radius * scale * absOf(1.0f - distance / focus); }

FORMULAS_END
#endif

// SPDX-License-Identifier: Apache-2.0
// The common subset of C++ and GLSL in which *.glsl.h formulas are written once: functions of float, int and bool, no
// branches (CHOOSE evaluates both sides), no arrays, no out-parameters, no std:: calls. C++ sees them in namespace
// gobo::formulas as inline functions that loops vectorise over; GLSL sees plain functions.
//   FORMULA      begins a function        PRECISE   keeps GLSL from contracting or reassociating the value
//   CHOOSE       branch-free select       bitsOf / floatOf   bit casts       floorOf minOf maxOf absOf sqrtOf
// minOf/maxOf with a NaN are unspecified (GLSL leaves them so): pass values through finiteOr (math.glsl.h) first.
#ifndef GOBO_FORMULAS_H
#define GOBO_FORMULAS_H

#define CHOOSE(condition, a, b) ((condition) ? (a) : (b))

#ifdef __cplusplus
#include <bit>

#define FORMULAS_BEGIN namespace gobo::formulas {
#define FORMULAS_END }
#define FORMULA inline
#define PRECISE
namespace gobo::formulas {
inline int bitsOf(float x) { return std::bit_cast<int>(x); }
inline float floatOf(int bits) { return std::bit_cast<float>(bits); }
inline float floorOf(float x) { return __builtin_floorf(x); }
inline float minOf(float a, float b) { return a < b ? a : b; }
inline float maxOf(float a, float b) { return a > b ? a : b; }
inline float absOf(float x) { return __builtin_fabsf(x); }
inline float sqrtOf(float x) { return __builtin_sqrtf(x); }  ///< x >= 0
}  // namespace gobo::formulas
#else
#define FORMULAS_BEGIN
#define FORMULAS_END
#define FORMULA
#define PRECISE precise
#define bitsOf(x) floatBitsToInt(x)
#define floatOf(bits) intBitsToFloat(bits)
#define floorOf(x) floor(x)
#define minOf(a, b) min(a, b)
#define maxOf(a, b) max(a, b)
#define absOf(x) abs(x)
#define sqrtOf(x) sqrt(x)
#endif

#endif

// SPDX-License-Identifier: Apache-2.0
// A digest of what this machine's arithmetic gives: the C library's functions (which it picks by processor) and Embree's hits (which picks its
// kernels by processor). Bits that were recorded where it is another can only be compared as numbers.
#pragma once

#include <gtest/gtest.h>

#include <cmath>

#include "base/hash.h"
#include "base/task_arena.h"
#include "scene/load.h"
#include "trace/accel.h"

namespace gobo::testing {

inline Hash128 arithmeticOfThisMachine() {
  Hasher h("arithmetic");
  for (int i = 1; i <= 2000; ++i) {
    const volatile double wide = i * 0.37919, unit = i * 0.0004177;  // unknown to the compiler, which would round some of them by itself
    const double x = wide, y = unit;
    for (const double v : {std::exp(-x), std::log(x), std::sin(x), std::cos(x), std::tan(x), std::pow(x, y), std::acos(y), std::asin(y), std::atan2(y, x),
                           std::cbrt(x), std::exp2(y), std::log2(x)})
      h.add(v);
    const float f = float(x), g = float(y);
    for (const float v : {std::exp(-f), std::log(f), std::sin(f), std::cos(f), std::tan(f), std::pow(f, g), std::acos(g), std::asin(g), std::atan2(g, f),
                          std::cbrt(f), std::exp2(g), std::log2(f)})
      h.add(v);
  }
  const ScenePtr scene = *makeBuiltinScene("tentacles");
  const TaskArena arena(1);
  const AccelPtr accel = Accel::build(SceneView(*scene, kAccelFacets, {}), arena);
  for (int i = 0; i < 256; ++i) {
    Ray rays[16];
    Hit hits[16];
    for (int k = 0; k < 16; ++k) {
      const float a = 0.1f * float(16 * i + k), e = 0.0003f * float(16 * i + k) - 0.6f;
      rays[k] = {Vec3(0.1f, 1.0f, 0.2f), glm::normalize(Vec3(std::cos(a), e, std::sin(a)))};
    }
    accel->intersect16(rays, 16, hits);
    for (int k = 0; k < 16; ++k) {
      Hit one;
      const bool met = accel->intersect(rays[k], one);
      h.add(met);
      if (met) h.add(one.t).add(one.u).add(one.v);
      h.add(hits[k].instance);
      if (hits[k].instance != kNoHit) h.add(hits[k].t).add(hits[k].u).add(hits[k].v);
    }
  }
  return h.digest();
}

}  // namespace gobo::testing

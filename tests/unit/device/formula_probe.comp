// SPDX-License-Identifier: Apache-2.0
// Every shared formula at every input, for comparison with the C++ side: out[f * count + i].
#version 450
#include "device/kernel.glsl.h"
#include "formulas/exponential_shadow_map.glsl.h"
#include "formulas/tone_map.glsl.h"
layout(local_size_x = 64) in;
layout(std430, binding = 0) readonly buffer In { float x[]; };
layout(std430, binding = 1) writeonly buffer Out { float y[]; };
PUSH_CONSTANTS Push { uint count; };
void main() {
  uint i = (gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) * 64u + gl_LocalInvocationID.x;
  if (i >= count) return;
  float v = x[i];
  y[0 * count + i] = fastExp(v);
  y[1 * count + i] = fastExp2(v);
  y[2 * count + i] = fastLog(v);
  y[3 * count + i] = fastSin(v);
  y[4 * count + i] = fastCos(v);
  y[5 * count + i] = toneMapFilmic(v);
  y[6 * count + i] = toneMapReinhard(v);
  y[7 * count + i] = esmEncode(v, 80.0);
  y[8 * count + i] = esmReceiver(v - 0.001, 80.0);
  y[9 * count + i] = esmVisibility(esmEncode(0.5, 80.0), esmReceiver(v, 80.0), true);
}

// SPDX-License-Identifier: Apache-2.0
// E = e^{c (z - 1)}, one texel an invocation.
#version 450
#include "device/kernel.glsl.h"
#include "formulas/exponential_shadow_map.glsl.h"
layout(local_size_x = 64) in;
layout(std430, binding = 0) readonly buffer Depth { float z[]; };
layout(std430, binding = 1) writeonly buffer Map { float e[]; };
PUSH_CONSTANTS Push { uint count; float c; };
void main() {
  uint i = (gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) * 64u + gl_LocalInvocationID.x;
  if (i < count) e[i] = esmEncode(z[i], c);
}

// SPDX-License-Identifier: Apache-2.0
// x[i] = 3 x[i] + i: does not commute with itself on other indices or orders.
#version 450
#include "device/kernel.glsl.h"
layout(local_size_x = 64) in;
layout(std430, binding = 0) buffer Data { uint x[]; };
PUSH_CONSTANTS Push { uint count; };
void main() {
  uint i = (gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) * 64u + gl_LocalInvocationID.x;
  if (i < count) x[i] = 3u * x[i] + i;
}

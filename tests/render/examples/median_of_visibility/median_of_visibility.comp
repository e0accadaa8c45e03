// SPDX-License-Identifier: Apache-2.0
// Median of one element an invocation; as MedianNode::at.
#version 450
#include "device/kernel.glsl.h"
#include "median.glsl.h"
layout(local_size_x = 64) in;
layout(std430, binding = 0) readonly buffer Visibility { float v[]; };
layout(std430, binding = 1) readonly buffer Instances { uint instance[]; };
layout(std430, binding = 2) writeonly buffer Result { float median[]; };
PUSH_CONSTANTS Push {
  int width, height;
  uint count;
} p;
float neighbour(uint e, int x, int y, int dx, int dy) {
  if (x + dx < 0 || x + dx >= p.width || y + dy < 0 || y + dy >= p.height) return v[e];
  uint other = uint(int(e) + dy * p.width + dx);
  return instance[other] == instance[e] ? v[other] : v[e];
}
void main() {
  uint e = (gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) * 64u + gl_LocalInvocationID.x;
  if (e >= p.count) return;
  int x = int(e % uint(p.width)), y = int(e / uint(p.width) % uint(p.height));
  median[e] = medianOf9(neighbour(e, x, y, -1, -1), neighbour(e, x, y, 0, -1), neighbour(e, x, y, 1, -1), neighbour(e, x, y, -1, 0), v[e],
                        neighbour(e, x, y, 1, 0), neighbour(e, x, y, -1, 1), neighbour(e, x, y, 0, 1), neighbour(e, x, y, 1, 1));
}

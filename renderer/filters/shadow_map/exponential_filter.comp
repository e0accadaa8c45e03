// SPDX-License-Identifier: Apache-2.0
// One direction of the separable Gaussian; taps beyond the map repeat its rim; sums in the order of the cpu loop.
#version 450
#include "device/kernel.glsl.h"
layout(local_size_x = 16, local_size_y = 16) in;
layout(std430, binding = 0) readonly buffer From { float a[]; };
layout(std430, binding = 1) readonly buffer Weights { float weight[]; };
layout(std430, binding = 2) writeonly buffer To { float b[]; };
PUSH_CONSTANTS Push { int width, height, radius, columns; };
void main() {
  ivec2 at = ivec2(gl_GlobalInvocationID.xy);
  if (at.x >= width || at.y >= height) return;
  precise float sum = 0.0;
  for (int k = -radius; k <= radius; ++k) {
    int x = clamp(at.x + (columns == 0 ? k : 0), 0, width - 1);
    int y = clamp(at.y + (columns == 0 ? 0 : k), 0, height - 1);
    sum = sum + weight[k + radius] * a[y * width + x];
  }
  b[at.y * width + at.x] = sum;
}

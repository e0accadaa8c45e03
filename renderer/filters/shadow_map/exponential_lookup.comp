// SPDX-License-Identifier: Apache-2.0
// Visibility of one view sample an invocation; as Receivers::fill, ShadowTexture::bilinear and the exponential basis.
#version 450
#include "device/kernel.glsl.h"
#include "formulas/exponential_shadow_map.glsl.h"
layout(local_size_x = 64) in;
layout(std430, binding = 0) readonly buffer Map { float e[]; };
layout(std430, binding = 1) readonly buffer Positions { float position[]; };
layout(std430, binding = 2) readonly buffer Instances { uint instance[]; };
layout(std430, binding = 3) writeonly buffer Visibility { float visibility[]; };
PUSH_CONSTANTS Push {
  vec4 u, v, w, d;
  float originX, originY, originZ, c, bias;
  int width, height;
  uint count;
} p;
float row(vec4 r, float x, float y, float z) { return shadowRow(r.x, r.y, r.z, r.w, x, y, z); }
void main() {
  uint i = (gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) * 64u + gl_LocalInvocationID.x;
  if (i >= p.count) return;
  precise float x = position[3u * i] - p.originX;
  precise float y = position[3u * i + 1u] - p.originY;
  precise float z = position[3u * i + 2u] - p.originZ;
  float inverseW = shadowInverse(row(p.w, x, y, z));
  precise float mu = row(p.u, x, y, z) * inverseW;
  precise float mv = row(p.v, x, y, z) * inverseW;
  float tx = shadowTexel(mu, float(p.width)), ty = shadowTexel(mv, float(p.height));
  int ix = int(tx), iy = int(ty);
  int at = iy * p.width + ix;
  int stepX = CHOOSE(ix + 1 < p.width, 1, 0), stepY = CHOOSE(iy + 1 < p.height, p.width, 0);
  float mean = shadowBilinear(e[at], e[at + stepX], e[at + stepY], e[at + stepY + stepX], tx - float(ix), ty - float(iy));
  bool covered = shadowCovered(mu, mv, inverseW) && instance[i] != 0xffffffffu;
  visibility[i] = esmVisibility(mean, esmReceiver(row(p.d, x, y, z) - p.bias, p.c), covered);
}

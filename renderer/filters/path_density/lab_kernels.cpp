// SPDX-License-Identifier: Apache-2.0
#include "filters/path_density/metric.h"
#include "formulas/path_density.glsl.h"

namespace gobo::pathdensity {

void labOf(float* __restrict r, float* __restrict g, float* __restrict b, int n) {
  for (int i = 0; i < n; ++i) {
    const float x = (0.4124564f * r[i] + 0.3575761f * g[i] + 0.1804375f * b[i]) * (1.0f / 0.95047f);
    const float y = 0.2126729f * r[i] + 0.7151522f * g[i] + 0.0721750f * b[i];
    const float z = (0.0193339f * r[i] + 0.1191920f * g[i] + 0.9503041f * b[i]) * (1.0f / 1.08883f);
    const float fx = formulas::labCurve(x), fy = formulas::labCurve(y), fz = formulas::labCurve(z);
    r[i] = 116.0f * fy - 16.0f;
    g[i] = 500.0f * (fx - fy);
    b[i] = 200.0f * (fy - fz);
  }
}

}  // namespace gobo::pathdensity

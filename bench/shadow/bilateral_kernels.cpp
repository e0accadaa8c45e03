// SPDX-License-Identifier: Apache-2.0
#include "shadow/bilateral_kernels.h"

#include <algorithm>
#include <cmath>

namespace gobo::shadowbench {
namespace {

struct Planes {
  const float *px, *py, *pz, *nx, *ny, *nz;
};

/// One row of one tap, added to sum and total: pixels [x0, x1) read x + shift of another row.
void addTap(const Planes& g, const float* __restrict from, const float* __restrict scale, size_t row, size_t other, size_t x0, size_t x1, long shift,
            float spatial, float* __restrict sum, float* __restrict total) {
  for (size_t x = x0; x < x1; ++x) {
    const size_t p = row + x, q = size_t(long(other + x) + shift);
    const float cosine = std::max(g.nx[p] * g.nx[q] + g.ny[p] * g.ny[q] + g.nz[p] * g.nz[q], 0.0f);
    const float c2 = cosine * cosine, c4 = c2 * c2, c8 = c4 * c4, c16 = c8 * c8;
    const float plane = ((g.px[q] - g.px[p]) * g.nx[p] + (g.py[q] - g.py[p]) * g.ny[p] + (g.pz[q] - g.pz[p]) * g.nz[p]) * scale[p];
    const float near = 1.0f / (1.0f + plane * plane);
    const float w = spatial * c16 * c16 * near * near;  // normals of the background are 0
    sum[x] += w * from[q];
    total[x] += w;
  }
}

}  // namespace

std::vector<float> jointBilateral(const TaskArena& arena, const Term& gbuffer, const std::vector<float>& V, int radius) {
  const size_t w = size_t(gbuffer.extent().width), h = size_t(gbuffer.extent().height), n = w * h;
  std::vector<float> planes(7 * n), in = V, out(n);
  const auto P = gbuffer.floats("P"), N = gbuffer.floats("N"), footprint = gbuffer.floats("footprint");
  arena.parallelFor(n, 4096, [&](size_t from, size_t to) {
    for (size_t i = from; i < to; ++i) {
      for (size_t k = 0; k < 3; ++k) {
        planes[k * n + i] = P[3 * i + k];
        planes[(3 + k) * n + i] = N[3 * i + k];
      }
      planes[6 * n + i] = footprint[i] > 0 ? 0.5f / footprint[i] : 0.0f;
    }
  });
  const Planes g{&planes[0], &planes[n], &planes[2 * n], &planes[3 * n], &planes[4 * n], &planes[5 * n]};
  const int passes = radius < 0 ? 3 : 1, reach = radius < 0 ? 2 : radius;
  for (int pass = 0; pass < passes; ++pass) {
    const long step = 1l << pass;
    const float sigma = radius < 0 ? 1.2f : float(radius) / 1.5f;
    arena.parallelFor(h, 4, [&](size_t from, size_t to) {
      std::vector<float> sum(w), total(w);
      for (size_t y = from; y < to; ++y) {
        std::fill(sum.begin(), sum.end(), 0.0f);
        std::fill(total.begin(), total.end(), 0.0f);
        for (long j = -reach; j <= reach; ++j) {
          const long oy = long(y) + j * step;
          if (oy < 0 || oy >= long(h)) continue;
          for (long i = -reach; i <= reach; ++i) {
            const long dx = i * step;
            const size_t x0 = size_t(std::max(0l, -dx)), x1 = size_t(std::min(long(w), long(w) - dx));
            if (x0 < x1)
              addTap(g, in.data(), &planes[6 * n], y * w, size_t(oy) * w, x0, x1, dx, std::exp(-0.5f * float(i * i + j * j) / (sigma * sigma)), sum.data(),
                     total.data());
          }
        }
        for (size_t x = 0; x < w; ++x) out[y * w + x] = total[x] > 0 ? sum[x] / total[x] : in[y * w + x];
      }
    });
    std::swap(in, out);
  }
  return in;
}

}  // namespace gobo::shadowbench

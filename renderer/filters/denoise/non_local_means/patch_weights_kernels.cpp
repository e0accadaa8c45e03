// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "filters/denoise/fast_exp.h"
#include "filters/denoise/non_local_means/patch_weights.h"

namespace gobo::denoise {

namespace {

/// Adds the distance of one channel for n pixels at p and as many at q.
void addPatchDistance(const float* __restrict p, const float* __restrict q, const float* __restrict vp, const float* __restrict vq, float perVariance, int n,
                      float* __restrict d) {
  for (int x = 0; x < n; ++x) {
    const float apart = p[x] - q[x], both = vp[x] + vq[x];
    // What differs by a millionth of the values is alike: their squares hold no more.
    const float floor = 1e-12f * (p[x] * p[x] + q[x] * q[x]) + 1e-30f;
    d[x] += (apart * apart - vp[x] - std::min(vp[x], vq[x])) / (perVariance * both + floor);
  }
}
void addPatchRow(const float* __restrict in, int n, float* __restrict sum) {
  for (int x = 0; x < n; ++x) sum[x] += in[x];
}
void toPatchWeights(const float* __restrict sum, float scale, int n, float* __restrict w) {
  for (int x = 0; x < n; ++x) w[x] = fastExp(-std::clamp(sum[x] * scale, 0.0f, 1e4f));
}

}  // namespace

void patchWeights(const GuidePlanes& g, const PatchSettings& s, int dx, int dy, int y0, int y1, float* w, std::vector<float>& scratch) {
  const int f = s.patch, rows = y1 - y0 + 2 * f, wide = g.width + 2 * f;
  scratch.assign(size_t(wide) + size_t(g.width) * size_t(rows + 1), 0.0f);
  float *distance = scratch.data(), *across = distance + wide, *sum = across + size_t(g.width) * size_t(rows);
  const float perVariance = s.damping * s.damping;
  const auto row = [&](int y) { return size_t(std::clamp(y, 0, g.height - 1)) * size_t(g.stride()) + size_t(g.margin - f); };
  for (int r = 0; r < rows; ++r) {
    const size_t p = row(y0 - f + r), q = row(y0 - f + r + dy);
    std::fill_n(distance, wide, 0.0f);
    for (int c = 0; c < 3; ++c) addPatchDistance(g.value[c] + p, g.value[c] + q + dx, g.variance[c] + p, g.variance[c] + q + dx, perVariance, wide, distance);
    for (int x = 0; x < wide; ++x) distance[x] = std::clamp(distance[x], -1e4f, 1e4f);
    for (int i = 0; i <= 2 * f; ++i) addPatchRow(distance + i, g.width, across + size_t(r) * size_t(g.width));
  }
  const float scale = 1.0f / float(3 * (2 * f + 1) * (2 * f + 1));
  for (int y = y0; y < y1; ++y) {
    std::fill_n(sum, g.width, 0.0f);
    for (int i = 0; i <= 2 * f; ++i) addPatchRow(across + size_t(y - y0 + i) * size_t(g.width), g.width, sum);
    toPatchWeights(sum, scale, g.width, w + size_t(y - y0) * size_t(g.width));
  }
}

}  // namespace gobo::denoise

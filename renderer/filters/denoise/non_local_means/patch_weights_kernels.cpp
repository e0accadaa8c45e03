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

void patchWeights(const GuidePlanes& g, const PatchSettings& s, int dx, int dy, const PixelRange& range, float* w, std::vector<float>& scratch) {
  const int f = s.patch, width = range.width(), rows = range.height() + 2 * f, wide = width + 2 * f;
  scratch.assign(size_t(wide) + size_t(width) * size_t(rows + 1), 0.0f);
  float *distance = scratch.data(), *across = distance + wide, *sum = across + size_t(width) * size_t(rows);
  const float perVariance = s.damping * s.damping;
  const auto row = [&](int y) { return size_t(std::clamp(y, 0, g.height - 1)) * size_t(g.stride()) + size_t(g.margin + range.x0 - f); };
  for (int r = 0; r < rows; ++r) {
    const size_t p = row(range.y0 - f + r), q = row(range.y0 - f + r + dy);
    std::fill_n(distance, wide, 0.0f);
    for (int c = 0; c < 3; ++c) addPatchDistance(g.value[c] + p, g.value[c] + q + dx, g.variance[c] + p, g.variance[c] + q + dx, perVariance, wide, distance);
    for (int x = 0; x < wide; ++x) distance[x] = std::clamp(distance[x], -1e4f, 1e4f);
    for (int i = 0; i <= 2 * f; ++i) addPatchRow(distance + i, width, across + size_t(r) * size_t(width));
  }
  const float scale = 1.0f / float(3 * (2 * f + 1) * (2 * f + 1));
  for (int y = 0; y < range.height(); ++y) {
    std::fill_n(sum, width, 0.0f);
    for (int i = 0; i <= 2 * f; ++i) addPatchRow(across + size_t(y + i) * size_t(width), width, sum);
    toPatchWeights(sum, scale, width, w + size_t(y) * size_t(width));
  }
}

size_t guideFloats(const NoisyPicture& p, int margin) { return size_t(p.halves ? 12 : 6) * size_t(p.width + 2 * margin) * size_t(p.height); }

bool makeGuides(const NoisyPicture& p, int margin, float* values, GuidePlanes (&guides)[2], const TaskArena& arena, const StopToken& stop) {
  const int halves = p.halves ? 2 : 1, stride = p.width + 2 * margin;
  const size_t size = size_t(stride) * size_t(p.height);
  for (int h = 0; h < halves; ++h) {
    guides[h] = {p.width, p.height, margin, {}, {}};
    for (int c = 0; c < 3; ++c) {
      guides[h].value[c] = values + size_t(6 * h + c) * size;
      guides[h].variance[c] = values + size_t(6 * h + 3 + c) * size;
    }
  }
  const float shares[2] = {p.halves ? p.shareOfA : 1.0f, 1.0f - p.shareOfA};
  return arena.parallelFor(
      size_t(p.height), 8,
      [&](size_t begin, size_t end) {
        for (size_t y = begin; y < end; ++y)
          for (int h = 0; h < halves; ++h)
            for (int c = 0; c < 3; ++c) {
              const std::span<const float> from = h ? p.b : p.a;
              float *value = values + size_t(6 * h + c) * size + y * size_t(stride), *variance = value + 3 * size;
              for (int x = -margin; x < p.width + margin; ++x) {
                const size_t i = 3 * (y * size_t(p.width) + size_t(std::clamp(x, 0, p.width - 1))) + size_t(c);
                value[x + margin] = from[i];
                variance[x + margin] = std::min(p.variance[i] / shares[h], 1e37f);
              }
            }
      },
      stop);
}

}  // namespace gobo::denoise

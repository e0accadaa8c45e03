// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "filters/denoise/fast_exp.h"
#include "filters/denoise/non_local_means/patch_weights.h"

namespace gobo::denoise {

namespace {

float channelDistance(float p, float q, float vp, float vq, float perVariance) {
  const float apart = p - q, both = vp + vq;
  // What differs by a millionth of the values is alike: their squares hold no more.
  const float floor = 1e-12f * (p * p + q * q) + 1e-30f;
  return (apart * apart - vp - std::min(vp, vq)) / (perVariance * both + floor);
}
/// Distances of n pixels at p and as many at q.
void pixelDistances(const GuidePlanes& g, size_t p, size_t q, float perVariance, int n, float* __restrict d) {
  const float* __restrict r = g.value[0], * __restrict e = g.value[1], * __restrict b = g.value[2];
  const float* __restrict vr = g.variance[0], * __restrict ve = g.variance[1], * __restrict vb = g.variance[2];
  for (int x = 0; x < n; ++x) {
    const size_t i = p + size_t(x), j = q + size_t(x);
    const float sum = channelDistance(r[i], r[j], vr[i], vr[j], perVariance) + channelDistance(e[i], e[j], ve[i], ve[j], perVariance) +
                      channelDistance(b[i], b[j], vb[i], vb[j], perVariance);
    d[x] = std::clamp(sum, -1e4f, 1e4f);
  }
}
template <int kCount>
void addPatchRows(const float* __restrict in, size_t step, int n, float* __restrict sum) {
  for (int x = 0; x < n; ++x) {
    float s = sum[x];
    for (int i = 0; i < kCount; ++i) s += in[size_t(i) * step + size_t(x)];
    sum[x] = s;
  }
}
/// Adds `count` rows `step` apart, one after the other; three at once, so that sums are seldom stored.
void addPatchRows(const float* in, size_t step, int count, int n, float* sum) {
  for (; count >= 3; count -= 3, in += 3 * step) addPatchRows<3>(in, step, n, sum);
  for (; count > 0; --count, in += step) addPatchRows<1>(in, step, n, sum);
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
    pixelDistances(g, p, size_t(ptrdiff_t(q) + dx), perVariance, wide, distance);
    addPatchRows(distance, 1, 2 * f + 1, width, across + size_t(r) * size_t(width));
  }
  const float scale = 1.0f / float(3 * (2 * f + 1) * (2 * f + 1));
  for (int y = 0; y < range.height(); ++y) {
    std::fill_n(sum, width, 0.0f);
    addPatchRows(across + size_t(y) * size_t(width), size_t(width), 2 * f + 1, width, sum);
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

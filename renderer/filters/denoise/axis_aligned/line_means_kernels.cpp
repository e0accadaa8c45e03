// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/axis_aligned/line_means.h"

#include <algorithm>
#include <cmath>

#include "filters/denoise/fast_exp.h"

namespace gobo::denoise {

namespace {

constexpr int kLineTile = 64;  // pixels of a row that share the longest reach

/// w[t] of the pixels p + t, t < n, and their neighbours at p + t + shift, `away` pixels off.
void lineWeights(const AlikePlanes& k, const LineWindow& window, size_t p, ptrdiff_t shift, float away, int n, const float* __restrict inverse,
                 const float* __restrict reach, float* __restrict w) {
  const float* __restrict nx = k.unit[0] + p, * __restrict ny = k.unit[1] + p, * __restrict nz = k.unit[2] + p;
  const float* __restrict x = k.place[0] + p, * __restrict y = k.place[1] + p, * __restrict z = k.place[2] + p;
  const float* __restrict footprint = k.footprint + p, * __restrict width = window.width + p;
  const float cosAngle = window.cosAngle, threshold = window.widthThreshold, off = 2.0f * std::max(1.0f, 0.25f * away);
  for (int t = 0; t < n; ++t) {
    const ptrdiff_t q = t + shift;
    const float dx = x[q] - x[t], dy = y[q] - y[t], dz = z[q] - z[t];
    const float along = nx[t] * dx + ny[t] * dy + nz[t] * dz, square = std::max(dx * dx + dy * dy + dz * dz - along * along, 0.0f);
    const float cosine = nx[q] * nx[t] + ny[q] * ny[t] + nz[q] * nz[t];
    // Positive too where the width there is -1, not to be used: a threshold is 1 at most.
    const float apart = std::fabs(width[q] - width[t]) - threshold * std::max(width[q], width[t]);
    float weight = fastExp(-square * inverse[t]);
    weight = cosine >= cosAngle ? weight : 0.0f;
    weight = std::fabs(along) <= off * footprint[t] ? weight : 0.0f;
    weight = apart <= 0.0f ? weight : 0.0f;
    w[t] = away <= reach[t] ? weight : 0.0f;
  }
}

void addDifferences(const float* __restrict w, const float* __restrict in, const float* __restrict centre, int n, float* __restrict sum) {
  for (int t = 0; t < n; ++t) sum[t] += w[t] * (in[t] - centre[t]);
}
void addWeights(const float* __restrict w, int n, float* __restrict sum) {
  for (int t = 0; t < n; ++t) sum[t] += w[t];
}

}  // namespace

void lineMeansRow(const AlikePlanes& k, const LineWindow& window, bool columns, const float* const* in, int channels, int y, float* const* out) {
  float w[kLineTile], inverse[kLineTile], reach[kLineTile], weight[kLineTile], sum[kMostChannels][kLineTile];
  for (int x0 = 0; x0 < k.width; x0 += kLineTile) {
    const int n = std::min(kLineTile, k.width - x0);
    const size_t at = size_t(y) * size_t(k.width) + size_t(x0);
    float most = 0;
    for (int t = 0; t < n; ++t) {
      const float width = window.width[at + size_t(t)], metres = width * k.footprint[at + size_t(t)];
      reach[t] = width > 0.0f && metres > 0.0f ? std::min(std::ceil(kReach * width), float(window.radius)) : 0.0f;
      inverse[t] = reach[t] > 0.0f ? 0.5f / std::max(metres * metres, 1e-36f) : 0.0f;
      most = std::max(most, reach[t]);
      weight[t] = 1.0f;  // the pixel itself
    }
    for (int c = 0; c < channels; ++c) std::fill_n(sum[c], n, 0.0f);
    for (int d = -int(most); d <= int(most); ++d) {
      if (d == 0 || (columns && (y + d < 0 || y + d >= k.height))) continue;
      const int begin = columns ? x0 : std::max(x0, -d), end = columns ? x0 + n : std::min(x0 + n, k.width - d), first = begin - x0, count = end - begin;
      if (count <= 0) continue;
      const size_t p = at + size_t(first);
      const ptrdiff_t shift = columns ? ptrdiff_t(d) * k.width : d;
      lineWeights(k, window, p, shift, float(std::abs(d)), count, inverse + first, reach + first, w);
      addWeights(w, count, weight + first);
      for (int c = 0; c < channels; ++c) addDifferences(w, in[c] + p + shift, in[c] + p, count, sum[c] + first);
    }
    for (int c = 0; c < channels; ++c)
      for (int t = 0; t < n; ++t) out[c][at + size_t(t)] = in[c][at + size_t(t)] + sum[c][t] / weight[t];
  }
}

}  // namespace gobo::denoise

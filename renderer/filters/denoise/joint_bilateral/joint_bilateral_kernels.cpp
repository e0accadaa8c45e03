// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/joint_bilateral/joint_bilateral_kernels.h"

#include <algorithm>
#include <cmath>

#include "filters/denoise/fast_exp.h"

namespace gobo::denoise {

namespace {

constexpr int kBilateralTile = 128;  // pixels of a row whose sums stay in the first cache

/// w[t]: of the pixels p + t + shift for p + t, as similarity() has it.
void bilateralWeights(const BilateralPlanes& k, const Alike& by, size_t p, ptrdiff_t shift, int n, float near, float* __restrict w) {
  const float* __restrict red = k.albedo[0] + p, * __restrict green = k.albedo[1] + p, * __restrict blue = k.albedo[2] + p;
  const float* __restrict nx = k.unit[0] + p, * __restrict ny = k.unit[1] + p, * __restrict nz = k.unit[2] + p, * __restrict length = k.length + p;
  const float* __restrict x = k.place[0] + p, * __restrict y = k.place[1] + p, * __restrict z = k.place[2] + p;
  const float* __restrict footprint = k.footprint + p, * __restrict hit = k.hit + p;
  const float perAlbedo = by.perAlbedo, perNormal = by.perNormal, perPlane = by.perPlane;
  for (int t = 0; t < n; ++t) {
    const ptrdiff_t q = t + shift;
    const auto square = [](float v) { return v * v; };
    const float albedo = square(red[q] - red[t]) + square(green[q] - green[t]) + square(blue[q] - blue[t]);
    // |n - m|^2 = 2 (1 - cosine), without the loss of 1 - cosine at small angles.
    const float turn = square(nx[q] - nx[t]) + square(ny[q] - ny[t]) + square(nz[q] - nz[t]);
    const float turned = length[t] * length[q] > 1e-12f ? turn : 0.0f;
    const float dx = x[q] - x[t], dy = y[q] - y[t], dz = z[q] - z[t];
    const float alongP = length[t] * std::fabs(nx[t] * dx + ny[t] * dy + nz[t] * dz), alongQ = length[q] * std::fabs(nx[q] * dx + ny[q] * dy + nz[q] * dz);
    const float width = std::max(footprint[t], footprint[q]) * std::max(std::min(length[t], length[q]), 1e-6f);
    const float ratio = std::max(alongP, alongQ) / (width > 0 ? width : 1.0f), apart = width > 0 ? std::min(ratio, 1e9f) : 0.0f;
    const float weight = near * fastExp(-perAlbedo * albedo - perNormal * turned - perPlane * apart * apart);
    w[t] = hit[t] == hit[q] ? weight : 0.0f;
  }
}

void addTap(const float* __restrict w, const float* __restrict in, int n, float* __restrict sum) {
  for (int t = 0; t < n; ++t) sum[t] += w[t] * in[t];
}
void addTapWeight(const float* __restrict w, int n, float* __restrict sum) {
  for (int t = 0; t < n; ++t) sum[t] += w[t];
}

}  // namespace

void bilateralRow(const BilateralPlanes& k, const Alike& by, const float* spatial, int radius, int y, float* const* out) {
  constexpr int kSums = 7;  // the weights last
  float w[kBilateralTile], row[kSums][kBilateralTile];
  double sums[kSums][kBilateralTile];
  const int all = k.channels + 1;
  for (int x0 = 0; x0 < k.width; x0 += kBilateralTile) {
    const int n = std::min(kBilateralTile, k.width - x0);
    const size_t at = size_t(y) * size_t(k.width) + size_t(x0);
    for (int c = 0; c < all; ++c) std::fill_n(sums[c], n, 0.0);
    for (int v = std::max(y - radius, 0); v <= std::min(y + radius, k.height - 1); ++v) {
      for (int c = 0; c < all; ++c) std::fill_n(row[c], n, 0.0f);
      const float nearY = spatial[std::abs(v - y)];
      for (int dx = -radius; dx <= radius; ++dx) {
        const int begin = std::max(x0, -dx), end = std::min(x0 + n, k.width - dx), first = begin - x0, count = end - begin;
        if (count <= 0) continue;
        const size_t p = at + size_t(first);
        const ptrdiff_t shift = ptrdiff_t(v - y) * k.width + dx;
        bilateralWeights(k, by, p, shift, count, spatial[std::abs(dx)] * nearY, w);
        addTapWeight(w, count, row[k.channels] + first);
        for (int c = 0; c < k.channels; ++c) addTap(w, k.light[c] + p + shift, count, row[c] + first);
      }
      // Single precision for a row of taps, double for the rows: up to 65 and 65 of them.
      for (int c = 0; c < all; ++c)
        for (int t = 0; t < n; ++t) sums[c][t] += double(row[c][t]);
    }
    for (int c = 0; c < k.channels; ++c)
      for (int t = 0; t < n; ++t) out[c][at + size_t(t)] = float(sums[c][t] / sums[k.channels][t]);
  }
}

}  // namespace gobo::denoise

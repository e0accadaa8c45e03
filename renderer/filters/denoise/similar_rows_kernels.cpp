// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/similar_rows.h"

#include <algorithm>
#include <cmath>

#include "filters/denoise/fast_exp.h"

namespace gobo::denoise {

namespace {

constexpr int kAlikeTile = 128;  // pixels of a row whose sums stay in the first cache

void addTap(const float* __restrict w, const float* __restrict in, int n, float* __restrict sum) {
  for (int t = 0; t < n; ++t) sum[t] += w[t] * in[t];
}
void addTapWeight(const float* __restrict w, int n, float* __restrict sum) {
  for (int t = 0; t < n; ++t) sum[t] += w[t];
}

}  // namespace

void alikeWeights(const AlikePlanes& k, const Alike& by, size_t p, ptrdiff_t shift, int n, float near, float* __restrict w) {
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

bool AlikeFeatures::fill(const Features& f, int width, int height, const TaskArena& arena, const StopToken& stop) {
  const size_t pixels = size_t(width) * size_t(height);
  values_ = Scratch<float>(kPlanes * pixels);
  const auto plane = [&](size_t k) { return values_.get() + k * pixels; };
  planes_.width = width;
  planes_.height = height;
  for (size_t c = 0; c < 3; ++c) {
    planes_.albedo[c] = plane(c);
    planes_.unit[c] = plane(3 + c);
    planes_.place[c] = plane(6 + c);
  }
  planes_.length = plane(9);
  planes_.footprint = plane(10);
  planes_.hit = plane(11);
  return arena.parallelFor(
      pixels, 1 << 13,
      [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i) {
          const bool hit = f.coverage[i] > 0;
          const float* n = &f.normal[3 * i];
          const double length = std::sqrt(double(n[0]) * n[0] + double(n[1]) * n[1] + double(n[2]) * n[2]);
          for (size_t c = 0; c < 3; ++c) {
            plane(c)[i] = hit ? f.albedo[3 * i + c] : 0.0f;
            plane(3 + c)[i] = hit && length > 0 ? float(n[c] / length) : 0.0f;
            plane(6 + c)[i] = hit ? f.position[3 * i + c] : 0.0f;
          }
          plane(9)[i] = hit ? float(length) : 0.0f;
          plane(10)[i] = hit ? f.footprint[i] : 0.0f;
          plane(11)[i] = hit ? 1.0f : 0.0f;
        }
      },
      stop);
}

void alikeMeansRow(const AlikePlanes& k, const Alike& by, const float* spatial, int radius, const float* const* light, int channels, int y, float* const* out) {
  constexpr int kSums = kMostChannels + 1;  // the weights last
  float w[kAlikeTile], row[kSums][kAlikeTile];
  double sums[kSums][kAlikeTile];
  const int all = channels + 1;
  for (int x0 = 0; x0 < k.width; x0 += kAlikeTile) {
    const int n = std::min(kAlikeTile, k.width - x0);
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
        alikeWeights(k, by, p, shift, count, spatial[std::abs(dx)] * nearY, w);
        addTapWeight(w, count, row[channels] + first);
        for (int c = 0; c < channels; ++c) addTap(w, light[c] + p + shift, count, row[c] + first);
      }
      // Single precision for a row of taps, double for the rows: up to 65 and 65 of them.
      for (int c = 0; c < all; ++c)
        for (int t = 0; t < n; ++t) sums[c][t] += double(row[c][t]);
    }
    for (int c = 0; c < channels; ++c)
      for (int t = 0; t < n; ++t) out[c][at + size_t(t)] = float(sums[c][t] / sums[channels][t]);
  }
}

}  // namespace gobo::denoise

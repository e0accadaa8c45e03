// SPDX-License-Identifier: Apache-2.0
// Percentage-closer kernels: comparisons of a receiver's plane with the texels around it, weighted by a separable kernel.
#pragma once

#include <algorithm>
#include <cmath>

#include "filters/shadow_map/depth_bounds.h"
#include "filters/shadow_map/receivers.h"

namespace gobo {
inline namespace filters {

/// Weights of one axis at one receiver: texels first .. first + count - 1.
struct AxisKernel {
  static constexpr int kMax = 132;
  int first = 0, count = 0;
  float weight[kMax];
  int last() const { return first + count - 1; }
};

/// A box of `width` texels around position x: whole texels count 1 / width, those at its ends their covered part. Of at most kMax texels.
inline void boxKernel(float x, float width, AxisKernel& k) {
  width = std::clamp(width, 1e-3f, float(AxisKernel::kMax - 2));
  const float lo = x - 0.5f * width + 0.5f, hi = lo + width;  // in texel edges: texel i is [i, i + 1]
  k.first = int(std::floor(lo));
  k.count = std::max(1, int(std::ceil(hi)) - k.first);
  const float inverse = 1.0f / width;
  for (int i = 0; i < k.count; ++i) k.weight[i] = std::max(0.0f, std::min(hi, float(k.first + i + 1)) - std::max(lo, float(k.first + i))) * inverse;
}

/// The discrete kernel `weights` (2 radius + 1) around position x, bilinearly interpolated between texels.
inline void interpolatedKernel(float x, const float* weights, int radius, AxisKernel& k) {
  const int at = int(std::floor(x));
  const float f = x - float(at);
  k.first = at - radius;
  k.count = 2 * radius + 2;
  k.weight[0] = (1.0f - f) * weights[0];
  for (int i = 1; i <= 2 * radius; ++i) k.weight[i] = (1.0f - f) * weights[i] + f * weights[i - 1];
  k.weight[2 * radius + 1] = f * weights[2 * radius];
}

/// A receiver as comparisons see it: depth at texel (i, j) is d + slopeX (i - x) + slopeY (j - y), bias subtracted.
struct ReceiverPlane {
  float x, y, d, slopeX, slopeY;
  float at(int i, int j) const { return d + (slopeX * (float(i) - x) + slopeY * (float(j) - y)); }
};
/// `slopeBias` half texels of slope come off, because a texel's depth is that of its centre.
inline ReceiverPlane receiverPlane(const ReceiverBlock& b, int i, float bias, float slopeBias) {
  return {b.x[i], b.y[i], b.d[i] - bias - slopeBias * 0.5f * (std::fabs(b.slopeX[i]) + std::fabs(b.slopeY[i])), b.slopeX[i], b.slopeY[i]};
}

enum class KernelVerdict { Mixed, Lit, Dark };
/// What depth bounds say about a kernel before any comparison; Mixed if they cannot tell.
inline KernelVerdict kernelVerdict(const DepthBounds& bounds, int face, const ReceiverPlane& r, int x0, int y0, int x1, int y1) {
  const int last = bounds.resolution() - 1;
  // The plane goes on beyond the rim, where taps repeat the map's: its reach is that of the whole kernel.
  const float reach = std::fabs(r.slopeX) * (std::max(r.x - float(x0), float(x1) - r.x) + 1.0f) +
                      std::fabs(r.slopeY) * (std::max(r.y - float(y0), float(y1) - r.y) + 1.0f) + 1e-6f;
  x0 = std::clamp(x0, 0, last);
  x1 = std::clamp(x1, 0, last);
  y0 = std::clamp(y0, 0, last);
  y1 = std::clamp(y1, 0, last);
  float lo, hi;
  bounds.range(face, x0, y0, x1, y1, lo, hi);
  if (r.d + reach <= lo) return KernelVerdict::Lit;
  if (r.d - reach > hi) return KernelVerdict::Dark;
  return KernelVerdict::Mixed;
}

/// compareKernel for kernels of N texels a row that lie inside the map along x: N lanes, no branch.
template <int N>
inline float compareRows(const float* z, int side, const ReceiverPlane& r, const AxisKernel& kx, const AxisKernel& ky) {
  float along[N], sum[N] = {};
  int32_t lit[N] = {};
  for (int i = 0; i < N; ++i) along[i] = r.slopeX * (float(kx.first + i) - r.x);
  for (int j = 0; j < ky.count; ++j) {
    const int y = ky.first + j;
    const float* row = z + size_t(std::clamp(y, 0, side - 1)) * size_t(side) + size_t(kx.first);
    const float across = r.slopeY * (float(y) - r.y), weight = ky.weight[j];
    for (int i = 0; i < N; ++i) {
      const bool pass = !(row[i] < r.d + (along[i] + across));  // a depth that is no number is lit
      sum[i] += pass ? weight : 0.0f;
      lit[i] += pass ? 1 : 0;
    }
  }
  float total = 0.0f;
  int32_t count = 0;
  for (int i = 0; i < N; ++i) {
    total += kx.weight[i] * sum[i];
    count += lit[i];
  }
  return count == 0 ? 0.0f : count == N * ky.count ? 1.0f : std::min(total, 1.0f);
}

/// Lit share of the kernel, in [0,1]; exactly 1 or 0 when every comparison says so. Taps outside the map repeat its rim.
inline float compareKernel(const float* z, int side, const ReceiverPlane& r, const AxisKernel& kx, const AxisKernel& ky) {
  const bool inside = kx.first >= 0 && kx.last() < side;
  if (inside && kx.count == 4) return compareRows<4>(z, side, r, kx, ky);
  if (inside && kx.count == 8) return compareRows<8>(z, side, r, kx, ky);
  float sum = 0.0f;
  int lit = 0;
  for (int j = 0; j < ky.count; ++j) {
    const int y = ky.first + j;
    const float* row = z + size_t(std::clamp(y, 0, side - 1)) * size_t(side);
    float part = 0.0f;
    for (int i = 0; i < kx.count; ++i) {
      const int x = kx.first + i;
      const int pass = !(row[inside ? x : std::clamp(x, 0, side - 1)] < r.at(x, y));
      part += pass ? kx.weight[i] : 0.0f;
      lit += pass;
    }
    sum += ky.weight[j] * part;
  }
  return lit == 0 ? 0.0f : lit == kx.count * ky.count ? 1.0f : std::min(sum, 1.0f);
}

}  // namespace filters
}  // namespace gobo

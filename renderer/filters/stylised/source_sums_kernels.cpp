// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "filters/stylised/source_sums.h"

namespace gobo {

namespace {

/// (nearest2 / r2)^(p/2) of every point: at most about 1, so that it underflows at worst.
template <int kPower>
inline void ratioPowers(const double* __restrict nearest2, const double* __restrict inverse2, int p, double* __restrict power) {
  if constexpr (kPower == 8) {
    for (size_t k = 0; k < kPatchPoints; ++k) {
      const double q = nearest2[k] * inverse2[k], q2 = q * q;
      power[k] = q2 * q2;
    }
  } else {
    double square[kPatchPoints];
    for (size_t k = 0; k < kPatchPoints; ++k) square[k] = nearest2[k] * inverse2[k];
    for (size_t k = 0; k < kPatchPoints; ++k) power[k] = p % 2 ? std::sqrt(square[k]) : 1.0;
    for (int n = p / 2; n > 0; n /= 2) {
      if (n % 2)
        for (size_t k = 0; k < kPatchPoints; ++k) power[k] *= square[k];
      for (size_t k = 0; k < kPatchPoints; ++k) square[k] *= square[k];
    }
  }
}

template <int kPower>
void add(const std::vector<PatchSources::Source>& sources, int p, PatchPoints& points) {
  double inverse2[kPatchPoints], power[kPatchPoints];
  for (const PatchSources::Source& s : sources) {
    const double sx = s.at.x, sy = s.at.y, sz = s.at.z;
    for (size_t k = 0; k < kPatchPoints; ++k) {
      const double x = points.x[k] - sx, y = points.y[k] - sy, z = points.z[k] - sz;
      inverse2[k] = 1.0 / (x * x + y * y + z * z);
    }
    ratioPowers<kPower>(points.nearest2, inverse2, p, power);
    if (s.point) {
      for (size_t k = 0; k < kPatchPoints; ++k) points.sum[k] += s.length * power[k];
      continue;
    }
    const auto [xx, yy, zz, xy, xz, yz] = s.moment;
    const double trace = xx + yy + zz, half = 0.5 * p, next = p + 2;
    for (size_t k = 0; k < kPatchPoints; ++k) {
      const double x = points.x[k] - sx, y = points.y[k] - sy, z = points.z[k] - sz, i2 = inverse2[k];
      const double along = (x * (xx * x + 2 * (xy * y + xz * z)) + y * (yy * y + 2 * yz * z) + z * zz * z) * i2;
      points.sum[k] += s.length * power[k] * (1.0 + half * i2 * (next * along - trace));
    }
  }
}

}  // namespace

void nearestSources(const std::vector<PatchSources::Source>& sources, PatchPoints& points) {
  for (const PatchSources::Source& s : sources) {
    const double sx = s.at.x, sy = s.at.y, sz = s.at.z;
    for (size_t k = 0; k < kPatchPoints; ++k) {
      const double x = points.x[k] - sx, y = points.y[k] - sy, z = points.z[k] - sz, d2 = x * x + y * y + z * z;
      points.nearest2[k] = d2 < points.nearest2[k] ? d2 : points.nearest2[k];
    }
  }
}

void addSources(const std::vector<PatchSources::Source>& sources, int p, PatchPoints& points) {
  if (p == 8) add<8>(sources, p, points);
  else add<0>(sources, p, points);
}

}  // namespace gobo

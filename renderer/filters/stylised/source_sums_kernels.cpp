// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "filters/stylised/source_sums.h"

namespace gobo {

namespace {

/// (nearest2 / r2)^(p/2) of every point: at most about 1, so that it underflows at worst.
template <int kPower>
inline void ratioPowers(const float* __restrict nearest2, const float* __restrict inverse2, int p, float* __restrict power) {
  if constexpr (kPower == 8) {
    for (size_t k = 0; k < kPatchPoints; ++k) {
      const float q = nearest2[k] * inverse2[k], q2 = q * q;
      power[k] = q2 * q2;
    }
  } else {
    float square[kPatchPoints];
    for (size_t k = 0; k < kPatchPoints; ++k) square[k] = nearest2[k] * inverse2[k];
    for (size_t k = 0; k < kPatchPoints; ++k) power[k] = p % 2 ? std::sqrt(square[k]) : 1.0f;
    for (int n = p / 2; n > 0; n /= 2) {
      if (n % 2)
        for (size_t k = 0; k < kPatchPoints; ++k) power[k] *= square[k];
      for (size_t k = 0; k < kPatchPoints; ++k) square[k] *= square[k];
    }
  }
}

template <int kPower>
void add(const std::vector<PatchSource>& sources, int p, PatchPoints& points) {
  float inverse2[kPatchPoints], power[kPatchPoints];
  for (const PatchSource& s : sources) {
    const float sx = s.x, sy = s.y, sz = s.z;
    for (size_t k = 0; k < kPatchPoints; ++k) {
      const float x = points.x[k] - sx, y = points.y[k] - sy, z = points.z[k] - sz;
      inverse2[k] = 1.0f / (x * x + y * y + z * z);
    }
    ratioPowers<kPower>(points.nearest2, inverse2, p, power);
    if (s.point) {
      for (size_t k = 0; k < kPatchPoints; ++k) points.sum[k] += s.length * power[k];
      continue;
    }
    const float xx = s.moment[0], yy = s.moment[1], zz = s.moment[2], xy = s.moment[3], xz = s.moment[4], yz = s.moment[5];
    const float trace = xx + yy + zz, half = 0.5f * float(p), next = float(p + 2);
    for (size_t k = 0; k < kPatchPoints; ++k) {
      const float x = points.x[k] - sx, y = points.y[k] - sy, z = points.z[k] - sz, i2 = inverse2[k];
      const float along = (x * (xx * x + 2.0f * (xy * y + xz * z)) + y * (yy * y + 2.0f * yz * z) + z * zz * z) * i2;
      points.sum[k] += s.length * power[k] * (1.0f + half * i2 * (next * along - trace));
    }
  }
}

}  // namespace

PatchSource patchSource(const PatchSources::Source& source, const DVec3& centre, double unit) {
  const DVec3 at = (source.at - centre) / unit;
  PatchSource s{float(at.x), float(at.y), float(at.z), float(source.length / unit), {}, source.point};
  for (size_t k = 0; k < 6; ++k) s.moment[k] = float(source.moment[k] / (unit * unit));
  return s;
}

void nearestSources(const std::vector<PatchSource>& sources, PatchPoints& points) {
  for (const PatchSource& s : sources) {
    const float sx = s.x, sy = s.y, sz = s.z;
    for (size_t k = 0; k < kPatchPoints; ++k) {
      const float x = points.x[k] - sx, y = points.y[k] - sy, z = points.z[k] - sz, d2 = x * x + y * y + z * z;
      points.nearest2[k] = d2 < points.nearest2[k] ? d2 : points.nearest2[k];
    }
  }
}

void addSources(const std::vector<PatchSource>& sources, int p, PatchPoints& points) {
  if (p == 8) add<8>(sources, p, points);
  else add<0>(sources, p, points);
}

}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/abstraction_kernels.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <type_traits>

#include "filters/denoise/fast_exp.h"

namespace gobo {
inline namespace filters {

namespace {

/// The planes as parameters of their own: GCC takes `restrict` of those alone.
template <bool kVaries>
void add(const float* __restrict ax, const float* __restrict ay, const float* __restrict az, const float* __restrict anx, const float* __restrict any,
         const float* __restrict anz, const float* __restrict ad, const float* __restrict bx, const float* __restrict by, const float* __restrict bz,
         const float* __restrict bnx, const float* __restrict bny, const float* __restrict bnz, const float* __restrict bd, const float* __restrict area,
         const float* __restrict narrower, size_t n, float reach2, float cosine, float* __restrict sums, float* __restrict weights) {
  for (size_t k = 0; k < n; ++k) {
    const float x = bx[k] - ax[k], y = by[k] - ay[k], z = bz[k] - az[k], far2 = x * x + y * y + z * z, r2 = kVaries ? far2 * narrower[k] : far2;
    const float dot = anx[k] * bnx[k] + any[k] * bny[k] + anz[k] * bnz[k];
    const float whole = denoise::fastExp(-0.5f * r2) * area[k];
    const float within = r2 <= reach2 ? whole : 0.0f, w = dot >= cosine ? within : 0.0f;
    sums[k] += w * (bd[k] - ad[k]);
    weights[k] += w;
  }
}

}  // namespace

void addOffset(const AbstractionPlanes& p, size_t e, ptrdiff_t offset, size_t n, float reach2, float cosine, float* sums, float* weights) {
  const size_t f = size_t(ptrdiff_t(e) + offset);
  const auto run = [&](auto varies) {
    add<decltype(varies)::value>(p.x + e, p.y + e, p.z + e, p.nx + e, p.ny + e, p.nz + e, p.d + e, p.x + f, p.y + f, p.z + f, p.nx + f, p.ny + f, p.nz + f,
                                 p.d + f, p.area + f, varies ? p.narrower + e : nullptr, n, reach2, cosine, sums, weights);
  };
  if (p.narrower) run(std::true_type());
  else run(std::false_type());
}

void addDisc(const AbstractionPlanes& p, int width, int height, int y, int begin, int end, float reach, int stride, float cosine, float* sums, float* weights) {
  const int taps = int(reach);
  for (int v = -std::min(taps, y / stride); v <= std::min(taps, (height - 1 - y) / stride); ++v) {
    const int across = int(std::sqrt(std::max(reach * reach - float(v * v), 0.0f)) + 0.5f);
    for (int u = -across; u <= across; ++u) {
      if (u == 0 && v == 0) continue;
      const int64_t shift = int64_t(u) * stride, from = std::max<int64_t>(begin, -shift), to = std::min<int64_t>(end, width - shift);
      if (from >= to) continue;
      addOffset(p, size_t(y) * size_t(width) + size_t(from), ptrdiff_t(v) * stride * width + ptrdiff_t(shift), size_t(to - from),
                kAbstractionReach * kAbstractionReach, cosine, sums + (from - begin), weights + (from - begin));
    }
  }
}

void splitVectors(const float* __restrict from, size_t n, float scale, float* __restrict x, float* __restrict y, float* __restrict z) {
  for (size_t k = 0; k < n; ++k) x[k] = scale * from[3 * k], y[k] = scale * from[3 * k + 1], z[k] = scale * from[3 * k + 2];
}

void joinSamples(const SurfaceRow& a, const SurfaceRow& b, size_t shift, size_t n, float cosine, float* __restrict joined) {
  const float *ax = a.x, *ay = a.y, *az = a.z, *bx = b.x + shift, *by = b.y + shift, *bz = b.z + shift, *aw = a.width, *bw = b.width + shift;
  const float *anx = a.nx, *any = a.ny, *anz = a.nz, *bnx = b.nx + shift, *bny = b.ny + shift, *bnz = b.nz + shift;
  const float *agx = a.gx, *agy = a.gy, *agz = a.gz, *bgx = b.gx + shift, *bgy = b.gy + shift, *bgz = b.gz + shift;
  const uint32_t *ai = a.id, *bi = b.id + shift;
  for (size_t k = 0; k < n; ++k) {
    const float x = bx[k] - ax[k], y = by[k] - ay[k], z = bz[k] - az[k], width = aw[k] > bw[k] ? aw[k] : bw[k];
    const float turn = anx[k] * bnx[k] + any[k] * bny[k] + anz[k] * bnz[k];
    const float above = x * agx[k] + y * agy[k] + z * agz[k], below = x * bgx[k] + y * bgy[k] + z * bgz[k];
    const int same = int(ai[k] == bi[k]) & int(ai[k] != ~0u) & int(turn >= cosine) & int(std::abs(above) <= width) & int(std::abs(below) <= width);
    joined[k] = same ? 1.0f : 0.0f;
  }
}

void areasOfRow(const SurfaceRow& a, const SurfaceRow& b, size_t n) {
  const float *ax = a.x, *ay = a.y, *az = a.z, *bx = b.x, *by = b.y, *bz = b.z;
  float* __restrict area = a.area;
  for (size_t k = 0; k < n; ++k) {
    const float ux = ax[k + 1] - ax[k], uy = ay[k + 1] - ay[k], uz = az[k + 1] - az[k], vx = bx[k] - ax[k], vy = by[k] - ay[k], vz = bz[k] - az[k];
    const float x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
    area[k] = std::sqrt(x * x + y * y + z * z);
  }
}

namespace {

void boundAreas(const SurfaceRow& r, size_t n, float least, float most) {
  float* __restrict area = r.area;
  const float* __restrict width = r.width;
  for (size_t k = 0; k < n; ++k) {
    const float own = area[k] > 0.0f ? area[k] : width[k] * width[k], low = own > least ? own : least;
    area[k] = low < most ? low : most;
  }
}

void meanOfCells(const float* __restrict wa, const float* __restrict wb, const float* __restrict a, const float* __restrict b, const float* __restrict inverse,
                 size_t n, float* __restrict mean) {
  for (size_t k = 0; k < n; ++k)
    mean[k] = ((wa[2 * k] * a[2 * k] + wa[2 * k + 1] * a[2 * k + 1]) + (wb[2 * k] * b[2 * k] + wb[2 * k + 1] * b[2 * k + 1])) * inverse[k];
}

}  // namespace

void cellsOfRows(const SurfaceRow& a, const SurfaceRow& b, size_t n, float least, float most, const SurfaceRow& cells) {
  boundAreas(a, 2 * n, least, most);
  boundAreas(b, 2 * n, least, most);
  const float* __restrict wa = a.area;
  const float* __restrict wb = b.area;
  float* __restrict area = cells.area;
  float* __restrict width = cells.width;
  for (size_t k = 0; k < n; ++k) area[k] = 1.0f / ((wa[2 * k] + wa[2 * k + 1]) + (wb[2 * k] + wb[2 * k + 1]));
  meanOfCells(wa, wb, a.x, b.x, area, n, cells.x);
  meanOfCells(wa, wb, a.y, b.y, area, n, cells.y);
  meanOfCells(wa, wb, a.z, b.z, area, n, cells.z);
  meanOfCells(wa, wb, a.nx, b.nx, area, n, cells.nx);
  meanOfCells(wa, wb, a.ny, b.ny, area, n, cells.ny);
  meanOfCells(wa, wb, a.nz, b.nz, area, n, cells.nz);
  meanOfCells(wa, wb, a.d, b.d, area, n, cells.d);
  float* __restrict nx = cells.nx;
  float* __restrict ny = cells.ny;
  float* __restrict nz = cells.nz;
  const float* __restrict aw = a.width;
  const float* __restrict bw = b.width;
  for (size_t k = 0; k < n; ++k) {
    const float l2 = nx[k] * nx[k] + ny[k] * ny[k] + nz[k] * nz[k], unit = 1.0f / std::sqrt(l2 > 1e-30f ? l2 : 1e-30f);
    nx[k] *= unit, ny[k] *= unit, nz[k] *= unit;
    const float sum = 1.0f / area[k], first = aw[2 * k] < aw[2 * k + 1] ? aw[2 * k] : aw[2 * k + 1],
                second = bw[2 * k] < bw[2 * k + 1] ? bw[2 * k] : bw[2 * k + 1];
    area[k] = sum < most ? sum : most;
    width[k] = first < second ? first : second;
  }
}

void wholeCells(const float* __restrict f0, const float* __restrict f1, const float* __restrict f2, const float* __restrict f3, size_t n,
                uint8_t* __restrict whole) {
  for (size_t k = 0; k < n; ++k) {
    const float left = f0[2 * k] * f1[2 * k] * f2[2 * k] * f3[2 * k], right = f0[2 * k + 1] * f1[2 * k + 1] * f2[2 * k + 1] * f3[2 * k + 1];
    whole[k] = left * right != 0.0f;
  }
}

}  // namespace filters
}  // namespace gobo

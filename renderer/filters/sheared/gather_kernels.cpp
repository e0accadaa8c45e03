// SPDX-License-Identifier: Apache-2.0
#include "filters/sheared/gather_kernels.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace gobo::sheared {
namespace {

/// What the shear of one pixel is in half edges of the light.
struct Shear {
  float u, v;                // of a metre of distance
  float inverseU, inverseV;  // 1 / (shear times half width of the tent)
  float inverseWidth, reach2;

  Shear(const GatherLayer& L, size_t p)
      : u(L.shear[p] / L.halfU),
        v(L.shear[p] / L.halfV),
        inverseU(1.0f / std::max(u * L.width[p], 1.0e-20f)),
        inverseV(1.0f / std::max(v * L.width[p], 1.0e-20f)),
        inverseWidth(1.0f / L.width[p]),
        reach2(6.0f * L.width[p] * L.width[p]) {}  // 6 standard deviations, as the axis-aligned filter's
};

struct Tap {
  float du, dv;  // metres in the plane through p that is parallel to the light, after q has moved along its line to the light's centre
  float weight;  // 0: nothing is taken from there
};
Tap tapOf(const GatherLayer& L, const Shear& s, size_t p, size_t q) {
  Tap t{(L.x[q] - L.x[p]) * L.height[p], (L.y[q] - L.y[p]) * L.height[p], 0.0f};
  if (L.instance[q] != L.instance[p] || L.n[q] == 0) return t;
  const float dx = L.px[q] - L.px[p], dy = L.py[q] - L.py[p], dz = L.pz[q] - L.pz[p];
  if (!(dx * dx + dy * dy + dz * dz <= s.reach2)) return t;
  if (!(L.nx[q] * L.nx[p] + L.ny[q] * L.ny[p] + L.nz[q] * L.nz[p] >= L.cosAngle)) return t;
  t.weight = std::max(1.0f - std::fabs(t.du) * s.inverseWidth, 0.0f) * std::max(1.0f - std::fabs(t.dv) * s.inverseWidth, 0.0f);
  return t;
}

/// The share of the tent from which a point at distance `end` tents from the light's end can be reached: half at the end, all from 1 on; 0 beyond the end.
inline float density(float end) {
  const float m = std::min(end, 1.0f), rest = 1.0f - m;
  return 1.0f - 0.5f * rest * rest;
}

constexpr int kLanes = 4;

}  // namespace

void addMoments(size_t n, const uint32_t* __restrict instance, const uint32_t* __restrict other, const float* __restrict values, float* __restrict sums,
                size_t plane, size_t stride) {
  for (size_t k = 0; k < 5; ++k) {
    const float* __restrict v = values + k * plane;
    float* __restrict s = sums + k * stride;
    for (size_t x = 0; x < n; ++x) s[x] += instance[x] == other[x] ? v[x] : 0.0f;
  }
}

Gathered gather(const GatherLayer& L, int x, int y, int rx, int ry) {
  const size_t p = size_t(y) * size_t(L.columns) + size_t(x), K = L.kept;
  const Shear s(L, p);
  float seen[kLanes] = {}, weight[kLanes] = {};
  Gathered g;
  for (int j = std::max(-ry, -y); j <= std::min(ry, L.rows - 1 - y); ++j)
    for (int i = std::max(-rx, -x); i <= std::min(rx, L.columns - 1 - x); ++i) {
      const size_t q = size_t(int64_t(p) + int64_t(j) * L.columns + i);
      Tap t = tapOf(L, s, p, q);
      t.weight *= L.area[q];  // a sum over pixels would count the denser side of the kernel more, and with it one end of the light
      if (!(t.weight > 0.0f)) continue;
      g.taken += double(t.weight);
      const float du = t.du * s.u, dv = t.dv * s.v;
      const float* points = L.points + 4 * K * q;
      const size_t count = std::min(size_t(L.n[q]), K);
      for (size_t b = 0; b < count; b += kLanes) {
        const float *u = points + b, *v = points + K + b, *w = points + 2 * K + b, *f = points + 3 * K + b;
        for (int l = 0; l < kLanes; ++l) {
          const float endU = (1.0f - std::fabs(u[l] + du)) * s.inverseU, endV = (1.0f - std::fabs(v[l] + dv)) * s.inverseV;
          float k = t.weight / (density(std::max(endU, 0.0f)) * density(std::max(endV, 0.0f)));
          k = endU > 0.0f ? k : 0.0f;
          k = endV > 0.0f ? k : 0.0f;
          weight[l] += k * w[l];
          seen[l] += k * f[l];
        }
      }
    }
  for (int l = 0; l < kLanes; ++l) {
    g.seen += double(seen[l]);
    g.weight += double(weight[l]);
  }
  return g;
}

float gatherRow(const GatherLayer& L, int x, int y, int rx, int bins, float* sums) {
  const size_t p = size_t(y) * size_t(L.columns) + size_t(x), K = L.kept;
  const Shear s(L, p);
  std::memset(sums, 0, sizeof(float) * 2 * size_t(bins));
  float taken = 0.0f;
  for (int i = std::max(-rx, -x); i <= std::min(rx, L.columns - 1 - x); ++i) {
    const size_t q = size_t(int64_t(p) + i);
    Tap t = tapOf(L, s, p, q);
    t.weight *= L.area[q];
    if (!(t.weight > 0.0f)) continue;
    taken += t.weight;
    const float du = t.du * s.u, dv = t.dv * s.v;
    const float* points = L.points + 4 * K * q;
    const size_t count = std::min(size_t(L.n[q]), K);
    for (size_t b = 0; b < count; ++b) {
      const float endU = (1.0f - std::fabs(points[b] + du)) * s.inverseU, v = points[K + b] + dv;
      if (!(endU > 0.0f) || !(std::fabs(v) <= 1.0f)) continue;
      const float k = t.weight / density(endU);
      const int bin = std::min(int(0.5f * (v + 1.0f) * float(bins)), bins - 1);
      sums[bin] += k * points[3 * K + b];
      sums[bins + bin] += k * points[2 * K + b];
    }
  }
  return taken;
}

Gathered gatherColumn(const GatherLayer& L, int x, int y, int ry, int bins, const float* sums, const float* taken) {
  const size_t p = size_t(y) * size_t(L.columns) + size_t(x);
  const Shear s(L, p);
  Gathered g;
  for (int j = std::max(-ry, -y); j <= std::min(ry, L.rows - 1 - y); ++j) {
    const size_t q = size_t(int64_t(p) + int64_t(j) * L.columns);
    if (!(L.shear[q] > 0.0f) || std::fabs(L.shear[q] - L.shear[p]) > 0.25f * L.shear[p]) continue;  // made for another shear
    const Tap t = tapOf(L, s, p, q);
    if (!(t.weight > 0.0f)) continue;
    g.taken += double(t.weight) * double(taken[q]);
    const float dv = t.dv * s.v;
    const float* row = sums + 2 * size_t(bins) * q;
    float seen = 0.0f, weight = 0.0f;
    for (int b = 0; b < bins; ++b) {
      const float endV = (1.0f - std::fabs((2.0f * float(b) + 1.0f) / float(bins) - 1.0f + dv)) * s.inverseV;
      const float k = endV > 0.0f ? t.weight / density(std::max(endV, 0.0f)) : 0.0f;
      seen += k * row[b];
      weight += k * row[bins + b];
    }
    g.seen += double(seen);
    g.weight += double(weight);
  }
  return g;
}

}  // namespace gobo::sheared

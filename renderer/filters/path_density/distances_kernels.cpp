// SPDX-License-Identifier: Apache-2.0
#include <cstdint>
#include <cstring>

#include "filters/path_density/distances.h"
#include "formulas/path_density.glsl.h"

namespace gobo::pathdensity {

namespace {

void distanceRow(const float* __restrict x, const float* __restrict y, const float* __restrict l, const float* __restrict a, const float* __restrict b,
                 const MetricPoint& from, int n, float* __restrict out) {
  const MetricPoint q = from;  // not looked up again after every store
  for (int j = 0; j < n; ++j) { out[j] = formulas::productDistance(x[j] - q.x, y[j] - q.y, l[j] - q.l, a[j] - q.a, b[j] - q.b); }
}

}  // namespace

void distancesTo(const MetricPoint& q, const MetricPoints& p, size_t begin, size_t n, float* out) {
  distanceRow(p.x.data() + begin, p.y.data() + begin, p.l.data() + begin, p.a.data() + begin, p.b.data() + begin, q, int(n), out);
}

Nearer nearerThan(const float* d, size_t n, float limit) {
  // Eight sums of their own; spelled out, as the compiler finds no good vectors for both.
  using Floats = float __attribute__((vector_size(32)));
  using Ints = int32_t __attribute__((vector_size(32)));
  Floats sum = {};
  Ints count = {};
  size_t j = 0;
  for (; j + 8 <= n; j += 8) {
    Floats v;
    std::memcpy(&v, d + j, sizeof v);
    const Ints nearer = v < limit;  // -1 where it is
    count -= nearer;
    sum += Floats(Ints(v) & nearer);
  }
  Nearer all;
  for (int k = 0; k < 8; ++k) {
    all.sum += double(sum[k]);
    all.count += size_t(count[k]);
  }
  for (; j < n; ++j) {
    if (!(d[j] < limit)) continue;
    all.sum += double(d[j]);
    ++all.count;
  }
  return all;
}

size_t countNearer(const float* d, size_t n, float limit) {
  int count = 0;
  for (size_t j = 0; j < n; ++j) count += d[j] < limit ? 1 : 0;
  return size_t(count);
}

size_t keepNearer(const float* d, size_t n, float limit, float* out) {
  size_t kept = 0;
  for (size_t j = 0; j < n; ++j) {
    out[kept] = d[j];
    kept += d[j] < limit ? 1 : 0;
  }
  return kept;
}

}  // namespace gobo::pathdensity

// SPDX-License-Identifier: Apache-2.0
// Distances from one point to a run of others, and what searches ask of them; vectorised.
#pragma once

#include <cstddef>

#include "filters/path_density/metric.h"

namespace gobo::pathdensity {

struct MetricPoint {
  float x, y, l, a, b;
};
inline MetricPoint pointAt(const MetricPoints& p, size_t i) { return {p.x[i], p.y[i], p.l[i], p.a[i], p.b[i]}; }

/// out[j] = distance of q to point begin + j, for j < n.
void distancesTo(const MetricPoint& q, const MetricPoints& points, size_t begin, size_t n, float* out);

struct Nearer {
  size_t count = 0;
  double sum = 0;
};
/// How many of d[0 .. n) are less than `limit`, and their sum.
Nearer nearerThan(const float* d, size_t n, float limit);
size_t countNearer(const float* d, size_t n, float limit);
/// Copies those less than `limit` to `out` (room for n), in order; returns how many.
size_t keepNearer(const float* d, size_t n, float limit, float* out);

}  // namespace gobo::pathdensity

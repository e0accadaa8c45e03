// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/compression/symmetric_eigen.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/check.h"

namespace gobo::transfer {

SymmetricEigen symmetricEigen(std::vector<double> a, size_t n) {
  GOBO_CHECK(a.size() == n * n);
  std::vector<double> v(n * n, 0.0);  // rows are turned with the matrix
  for (size_t i = 0; i < n; ++i) v[i * n + i] = 1;
  double norm = 0;
  for (const double x : a) norm += x * x;
  constexpr int kSweeps = 60;  // some ten are needed; quadratic at the end
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    double off = 0;
    for (size_t i = 0; i < n; ++i)
      for (size_t j = i + 1; j < n; ++j) off += 2 * a[i * n + j] * a[i * n + j];
    if (!(off > 1e-30 * norm)) break;
    for (size_t p = 0; p < n; ++p)
      for (size_t q = p + 1; q < n; ++q) {
        const double apq = a[p * n + q];
        if (apq == 0) continue;
        // The smaller of the two angles that make a_pq 0.
        const double theta = (a[q * n + q] - a[p * n + p]) / (2 * apq), t = std::copysign(1.0, theta) / (std::fabs(theta) + std::sqrt(theta * theta + 1)),
                     c = 1 / std::sqrt(t * t + 1), s = t * c;
        for (size_t k = 0; k < n; ++k) {
          const double x = a[p * n + k], y = a[q * n + k];
          a[p * n + k] = c * x - s * y;
          a[q * n + k] = s * x + c * y;
        }
        for (size_t k = 0; k < n; ++k) {
          const double x = a[k * n + p], y = a[k * n + q];
          a[k * n + p] = c * x - s * y;
          a[k * n + q] = s * x + c * y;
        }
        for (size_t k = 0; k < n; ++k) {
          const double x = v[p * n + k], y = v[q * n + k];
          v[p * n + k] = c * x - s * y;
          v[q * n + k] = s * x + c * y;
        }
      }
  }
  std::vector<size_t> order(n);
  std::iota(order.begin(), order.end(), size_t(0));
  std::stable_sort(order.begin(), order.end(), [&](size_t i, size_t j) { return a[i * n + i] > a[j * n + j]; });
  SymmetricEigen out;
  for (const size_t i : order) {
    out.values.push_back(a[i * n + i]);
    out.vectors.insert(out.vectors.end(), v.begin() + long(i * n), v.begin() + long((i + 1) * n));
  }
  return out;
}

}  // namespace gobo::transfer

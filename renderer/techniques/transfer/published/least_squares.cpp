// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/published/least_squares.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"

namespace gobo::transfer::published {

namespace {

/// Of some unknowns, the others being 0.
std::vector<double> solveSome(const std::vector<double>& gram, const std::vector<double>& moment, const std::vector<bool>& used) {
  const size_t n = moment.size();
  std::vector<size_t> index;
  for (size_t i = 0; i < n; ++i)
    if (used[i]) index.push_back(i);
  std::vector<double> g, b, out(n, 0.0);
  for (const size_t i : index) {
    b.push_back(moment[i]);
    for (const size_t j : index) g.push_back(gram[i * n + j]);
  }
  const std::vector<double> x = solveSymmetric(g, b);
  for (size_t k = 0; k < index.size(); ++k) out[index[k]] = x[k];
  return out;
}

}  // namespace

std::vector<double> solveSymmetric(const std::vector<double>& gram, const std::vector<double>& moment) {
  const size_t n = moment.size();
  GOBO_CHECK(gram.size() == n * n);
  std::vector<double> lower(n * n, 0.0), x(n, 0.0);
  std::vector<bool> alone(n, true);
  for (size_t i = 0; i < n; ++i) {
    for (size_t j = 0; j <= i; ++j) {
      if (!alone[j]) continue;
      double sum = gram[i * n + j];
      for (size_t k = 0; k < j; ++k) sum -= lower[i * n + k] * lower[j * n + k];
      if (j < i) {
        lower[i * n + j] = sum / lower[j * n + j];
      } else if (sum > 1e-12 * gram[i * n + i]) {
        lower[i * n + i] = std::sqrt(sum);
      } else {
        alone[i] = false;  // its row stays out of all sums
        std::fill(lower.begin() + long(i * n), lower.begin() + long(i * n + i), 0.0);
      }
    }
  }
  for (size_t i = 0; i < n; ++i) {
    if (!alone[i]) continue;
    double sum = moment[i];
    for (size_t k = 0; k < i; ++k) sum -= lower[i * n + k] * x[k];
    x[i] = sum / lower[i * n + i];
  }
  for (size_t i = n; i-- > 0;) {
    if (!alone[i]) continue;
    double sum = x[i];
    for (size_t k = i + 1; k < n; ++k) sum -= lower[k * n + i] * x[k];
    x[i] = sum / lower[i * n + i];
  }
  return x;
}

std::vector<double> solveNonNegative(const std::vector<double>& gram, const std::vector<double>& moment, size_t free) {
  const size_t n = moment.size();
  std::vector<bool> used(n, false);
  std::fill(used.begin(), used.begin() + long(free), true);
  std::vector<double> x = solveSome(gram, moment, used);
  for (size_t step = 0; step < 3 * n + 10; ++step) {  // each step leaves a smaller square, so no set comes twice; three rounds are many
    size_t best = n;
    double steepest = 0;
    for (size_t i = free; i < n; ++i) {
      if (used[i] || !(gram[i * n + i] > 0)) continue;
      double slope = moment[i], size = std::fabs(moment[i]);
      for (size_t k = 0; k < n; ++k) {
        slope -= gram[i * n + k] * x[k];
        size += std::fabs(gram[i * n + k] * x[k]);
      }
      const double gain = slope / std::sqrt(gram[i * n + i]);
      if (slope > 1e-11 * size && gain > steepest) {
        steepest = gain;
        best = i;
      }
    }
    if (best == n) return x;
    used[best] = true;
    for (std::vector<double> to = solveSome(gram, moment, used);; to = solveSome(gram, moment, used)) {
      double part = 1;  // of the way that may be gone before an unknown turns negative
      size_t first = n;
      for (size_t i = free; i < n; ++i)
        if (used[i] && to[i] <= 0 && x[i] / (x[i] - to[i] + 1e-300) < part) {
          part = x[i] / (x[i] - to[i] + 1e-300);
          first = i;
        }
      for (size_t i = 0; i < n; ++i) x[i] += part * (to[i] - x[i]);
      if (first == n) break;
      used[first] = false;
      x[first] = 0;
      for (size_t i = free; i < n; ++i)
        if (used[i] && x[i] <= 0 && to[i] <= 0) {
          used[i] = false;
          x[i] = 0;
        }
    }
    for (size_t i = free; i < n; ++i)
      if (!used[i]) x[i] = 0;
  }
  return x;
}

}  // namespace gobo::transfer::published

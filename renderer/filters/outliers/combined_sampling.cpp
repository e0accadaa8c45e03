// SPDX-License-Identifier: Apache-2.0
#include "filters/outliers/combined_sampling.h"

#include <algorithm>
#include <cstddef>

namespace gobo::outliers {

namespace {

struct PairMeans {
  double f = 0, g = 0;
};
PairMeans pairMeans(std::span<const double> f, std::span<const double> g) {
  PairMeans m;
  for (size_t i = 0; i < f.size(); ++i) {
    m.f += f[i] / double(f.size());
    m.g += g[i] / double(f.size());
  }
  return m;
}

/// mean of f_i - beta_i (g_i - C), beta_i = cov(f, g) / var(g) of the others.
double withOwnBeta(std::span<const double> f, std::span<const double> g, double known, const PairMeans& mean) {
  const double n = double(f.size());
  double both = 0, own = 0, squares = 0;
  for (size_t i = 0; i < f.size(); ++i) {
    both += (f[i] - mean.f) * (g[i] - mean.g);
    own += (g[i] - mean.g) * (g[i] - mean.g);
    squares += g[i] * g[i];
  }
  double sum = 0;
  for (size_t i = 0; i < f.size(); ++i) {
    // Sums about the mean without one: less n / (n - 1) times its own product.
    const double part = n / (n - 1), df = f[i] - mean.f, dg = g[i] - mean.g;
    const double var = own - part * dg * dg, cov = both - part * df * dg;
    // Less is rounding: g does not vary among the others, which say nothing then.
    const double beta = f.size() > 2 && var > 1e-13 * squares ? cov / var : 0.0;
    sum += f[i] - beta * (g[i] - known);
  }
  return sum / n;
}

}  // namespace

double combinedEstimate(std::span<const double> f, std::span<const double> g, double known, Combination how) {
  if (f.empty()) return 0.0;
  const PairMeans mean = pairMeans(f, g);
  switch (how) {
    case Combination::Additive: return mean.f;
    case Combination::Subtractive: return known + (mean.f - mean.g);
    case Combination::Combined: return withOwnBeta(f, g, known, mean);
    case Combination::Ratio: return mean.g != 0 ? known * (mean.f / mean.g) : mean.f;
  }
  return 0.0;
}

}  // namespace gobo::outliers

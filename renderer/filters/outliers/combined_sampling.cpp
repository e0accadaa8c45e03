// SPDX-License-Identifier: Apache-2.0
#include "filters/outliers/combined_sampling.h"

#include <algorithm>
#include <cstddef>
#include <vector>

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

/// cov(f, g) / var(g); 0 where they say nothing: of fewer than two, or of g that does not vary beyond rounding.
double betaOf(const PairSums& s) {
  if (s.n < 2) return 0.0;
  const double var = s.gg - s.g * s.g / s.n, cov = s.fg - s.f * s.g / s.n;
  return var > 1e-13 * (s.gg + s.n) ? cov / var : 0.0;
}

}  // namespace

void PairSums::add(double fi, double gi, double known) {
  if (known == 0) return;
  const double a = fi / known, b = gi / known - 1;
  n += 1;
  f += a;
  g += b;
  fg += a * b;
  gg += b * b;
}

double combinedWith(std::span<const double> f, std::span<const double> g, double known, const PairSums& around) {
  if (f.empty()) return 0.0;
  // Sums of all after i, for each; those before it with what is around are added on the way: nothing is taken out of a sum again, which would cost digits.
  std::vector<PairSums> after(f.size());
  for (size_t i = f.size() - 1; i > 0; --i) {
    after[i - 1] = after[i];
    after[i - 1].add(f[i], g[i], known);
  }
  PairSums before = around;
  double sum = 0;
  for (size_t i = 0; i < f.size(); ++i) {
    sum += f[i] - betaOf(before + after[i]) * (g[i] - known);
    before.add(f[i], g[i], known);
  }
  return sum / double(f.size());
}

double combinedEstimate(std::span<const double> f, std::span<const double> g, double known, Combination how) {
  if (f.empty()) return 0.0;
  const PairMeans mean = pairMeans(f, g);
  switch (how) {
    case Combination::Additive: return mean.f;
    case Combination::Subtractive: return known + (mean.f - mean.g);
    case Combination::Combined: return combinedWith(f, g, known, {});
    case Combination::Ratio: return mean.g != 0 ? known * (mean.f / mean.g) : mean.f;
  }
  return 0.0;
}

}  // namespace gobo::outliers

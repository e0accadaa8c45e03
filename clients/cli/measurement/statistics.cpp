// SPDX-License-Identifier: Apache-2.0
#include "measurement/statistics.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "measure/confidence.h"

namespace gobo::cli {
namespace {

constexpr double kCovered = 0.95, kNormalQuantile975 = 1.959963984540054;

double sortedQuantile(const std::vector<double>& sorted, double probability) {
  const double at = probability * double(sorted.size() - 1);
  const size_t below = std::min(size_t(at), sorted.size() - 1), above = std::min(below + 1, sorted.size() - 1);
  return sorted[below] + (at - double(below)) * (sorted[above] - sorted[below]);
}

/// 0.975 quantile; the series of measure/confidence.h begins at 3.
double student975(size_t degrees) {
  if (degrees == 1) return 12.706204736432095;
  if (degrees == 2) return 4.302652729911275;
  return studentQuantile(kNormalQuantile975, double(degrees));
}

}  // namespace

double quantile(std::vector<double> values, double probability) {
  GOBO_CHECK(!values.empty() && probability >= 0 && probability <= 1);
  std::sort(values.begin(), values.end());
  return sortedQuantile(values, probability);
}

TimeFigures timeFigures(const std::vector<double>& times) {
  GOBO_CHECK(!times.empty());
  std::vector<double> sorted = times;
  std::sort(sorted.begin(), sorted.end());
  const size_t n = sorted.size();
  TimeFigures out{sortedQuantile(sorted, 0.5), sortedQuantile(sorted, 0.25), sortedQuantile(sorted, 0.75), sorted.front(), sorted.back()};
  // below: P(Binomial(n, 1/2) < k) with k counted from 1; in logarithms, since 2^-n underflows where runs are many.
  size_t k = 1;
  double below = std::exp(-double(n) * std::log(2.0)), term = -double(n) * std::log(2.0);
  for (size_t next = 2; 2 * next <= n; ++next) {
    term += std::log(double(n - next + 2) / double(next - 1));
    if (1 - 2 * (below + std::exp(term)) < kCovered) break;
    below += std::exp(term);
    k = next;
  }
  out.low = sorted[k - 1], out.high = sorted[n - k];
  out.confidence = std::max(0.0, 1 - 2 * below);
  return out;
}

ErrorFigure errorFigure(const std::vector<HalvesError>& repeats) {
  GOBO_CHECK(!repeats.empty());
  const double n = double(repeats.size());
  ErrorFigure out;
  double down = 0, up = 0, deviations = 0;
  for (const HalvesError& e : repeats) {
    out.mse += e.mse / n, out.relMse += e.relMse / n;
    out.mseStandardError += e.standardError / n, out.relMseStandardError += e.relMseStandardError / n;
    // An interval of squares begins at 0 or above, an estimate of them may lie below.
    down += std::max(0.0, e.mse - e.mseLow) / n, up += std::max(0.0, e.mseHigh - e.mse) / n;
    out.nonFinite = std::max(out.nonFinite, e.nonFinite);
  }
  double relative = 0;
  for (const HalvesError& e : repeats) deviations += (e.mse - out.mse) * (e.mse - out.mse), relative += (e.relMse - out.relMse) * (e.relMse - out.relMse);
  if (repeats.size() > 1) {
    const double ofMean = 1 / (n * (n - 1));
    const double between = student975(repeats.size() - 1) * std::sqrt(deviations * ofMean);
    down = std::hypot(down, between), up = std::hypot(up, between);
    out.mseStandardError = std::hypot(out.mseStandardError, std::sqrt(deviations * ofMean));
    out.relMseStandardError = std::hypot(out.relMseStandardError, std::sqrt(relative * ofMean));
  }
  out.mseLow = std::max(0.0, out.mse - down), out.mseHigh = std::max(0.0, out.mse + up);
  out.rmse = std::sqrt(std::max(0.0, out.mse)), out.rmseLow = std::sqrt(out.mseLow), out.rmseHigh = std::sqrt(out.mseHigh);
  return out;
}

}  // namespace gobo::cli

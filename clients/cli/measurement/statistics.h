// SPDX-License-Identifier: Apache-2.0
// What the repeats of one point say together: quantiles of time, error with its interval. Pure; any thread.
#pragma once

#include <vector>

#include "measure/metrics.h"

namespace gobo::cli {

/// Linear between order statistics, the k-th of n (from 0) at probability k / (n - 1) (type 7 of Hyndman, Fan, The American Statistician 50, 1996; numpy's
/// default). `values` need no order; at least one (CHECKed), 0 <= probability <= 1 (CHECKed).
double quantile(std::vector<double> values, double probability);

struct TimeFigures {
  double median = 0, lowerQuartile = 0, upperQuartile = 0, least = 0, most = 0;
  /// Interval for the median of all such runs by order statistics, whatever their distribution (runs taken as independent): the narrowest pair of k-th smallest
  /// and k-th largest that covers it with at least 95 %; of fewer than 6 runs least and most, which cover less.
  double low = 0, high = 0;
  double confidence = 0;  ///< what the pair covers it with: 1 - 2 P(Binomial(n, 1/2) < k); 0 of one run
};
/// At least one time (CHECKed). O(n log n).
TimeFigures timeFigures(const std::vector<double>& times);

struct ErrorFigure {
  double mse = 0, mseStandardError = 0, mseLow = 0, mseHigh = 0;  ///< low, high: 95 %
  double rmse = 0, rmseLow = 0, rmseHigh = 0;                     ///< roots, of what is positive
  double relMse = 0, relMseStandardError = 0;
  size_t nonFinite = 0;  ///< pixels, most of any repeat
};
/// Error of a point from its repeats' pictures (at least one, CHECKed), which may be the same picture or (halt.time_s) others. The repeats share reference and
/// seed, so that averaging is not taken to narrow the interval of one picture (each side's mean distance stays); what the repeats differ by is added to it in
/// quadrature, Student's t over them (Zou, Donner, Statistics in Medicine 27, 2008).
ErrorFigure errorFigure(const std::vector<HalvesError>& repeats);

}  // namespace gobo::cli

// SPDX-License-Identifier: Apache-2.0
// A 95 % confidence interval for the mean of a non-negative quantity that is seen through unbiased noise and whose
// large values may be rare: squared errors of pixels. Pure functions; any thread. Method and coverage: docs/certificate.md.
#pragma once

#include <cstddef>
#include <vector>

namespace gobo {

/// Quantile of Student's t, `degrees` >= 3 (Hill's series in 1/degrees, error < 1e-3 from 8 degrees on), at `normalQuantile`,
/// the quantile of the normal distribution for the same probability (1.959964 for 0.975).
double studentQuantile(double normalQuantile, double degrees);
/// x with P(shape, x) = probability, P the regularised lower incomplete gamma function. shape > 0, 0 < probability < 1;
/// relative error < 1e-9. Underflows to 0 for tiny shapes.
double gammaQuantile(double shape, double probability);

struct MeanInterval {
  double mean = 0;           ///< plain mean, may be negative
  double standardError = 0;  ///< of independent draws: an upper estimate for stratified ones
  double low = 0, high = 0;  ///< 95 %, 2.5 % on each side; 0 <= low <= high
};
/// `z` one value per drawn pixel, E[z_i | pixel i] = its squared error >= 0. Cost O(n). Empty input: zeros.
///  low:  max(0, mean - t * se), Student's t.
///  high: the larger of mean + t * se and the upper limit of Fay and Feuer (Statistics in Medicine 16, 1997) for a weighted
///        sum of Poisson counts, each drawn pixel being one event of weight z/n and one more event, 1.5 times as large as the
///        largest seen, being granted: at least exact for a rare error of one size, equal to the normal limit for a common one.
MeanInterval meanInterval(const std::vector<double>& z);

}  // namespace gobo

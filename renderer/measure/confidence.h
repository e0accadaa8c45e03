// SPDX-License-Identifier: Apache-2.0
// A 95 % confidence interval for the mean of a non-negative quantity that is seen through unbiased noise and whose
// large values may be rare: squared errors of pixels. Pure functions; any thread. Method and coverage: docs/certificate.md.
#pragma once

#include <cstddef>
#include <vector>

namespace gobo {
inline namespace measure {

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

/// What one drawn pixel says.
struct DrawnValue {
  double value = 0;   ///< E = its squared error >= 0
  double noise = 0;   ///< variance of `value` for this pixel, or more
  double spread = 0;  ///< variance of the reference there, in the same units as `value`
  double chance = 1;  ///< to be drawn, above 0; 1: certain
  bool dark = false;  ///< the picture is darker than the reference
};
struct DrawnInterval {
  double mean = 0;  ///< Horvitz-Thompson: sum of value / chance over all pixels' number; may be negative
  double standardError = 0;
  double low = 0;          ///< 95 %, 2.5 % on each side; 0 <= low <= highTrimmed <= high
  double highTrimmed = 0;  ///< of the mean without the pixels of `unseenArea` with the largest values
  double high = 0;         ///< of the whole mean, if no pixel of that area is worse than the worst that was drawn by chance
  double unseenArea = 0;   ///< share of the pixels that no draw meets with a chance of 5 %, wherever they lie; 0 where all are certain
};
/// Interval for the mean over `all` pixels from those drawn with unequal chances (measure/certificate_pixels.h). O(n).
///  variance     (1 - chance) (value / chance)^2 of the draw (Poisson sampling's, above that of a spread-out sample of fixed
///               size) + noise / chance. The noise of certain pixels together is at least 4 times their values times the mean spread
///               of the 64 pixels of largest value, or of all certain ones: where rare paths make most of the spread, few pixels
///               see them, and each one's own noise is mostly too small.
///  low          mean - t * standard error
///  highTrimmed  the limit of Fay and Feuer as in meanInterval for the pixels drawn by chance, Student's for the certain ones, whose
///               degrees of freedom are those of their noise (Satterthwaite, Biometrics Bulletin 2, 1946: 3 for a pixel, from four
///               parts): rare paths leave it to few pixels; the distances of the two from their estimates are added in quadrature
///               (Zou & Donner, Statistics in Medicine 27, 2008)
///  high         the same with every pixel that is too dark, certain or not, among Fay and Feuer's events, since a reference misses
///               light by rare paths there too, + unseenArea * largest value drawn by chance
DrawnInterval drawnInterval(const std::vector<DrawnValue>& drawn, double all);

}  // namespace measure
}  // namespace gobo

// SPDX-License-Identifier: Apache-2.0
// Whether two renders, each in K independent parts of equal effort, are of one thing. The parts need not be Gaussian, nor their pixels independent, nor the two
// renders: what each difference of parts could have been is taken from the data by flipping its sign. Pure functions; any thread. Method and what it finds:
// docs/regression.md.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/image.h"
#include "base/status.h"

namespace gobo {
inline namespace measure {

/// A render without noise has one part; one with noise at least kFewestParts, so that 2^(K-1) - 1 other signs are 127 or more.
inline constexpr int kFewestParts = 8, kMostParts = 16;
/// Standard deviations above the mean over sign flips from which on a statistic speaks of a change.
inline constexpr double kChangeExcess = 6;

struct ChangeOptions {
  double tolerance = 1e-4;  ///< relative to the radiance around a pixel: a steady difference of that much is no change
};

/// One statistic, as it is and over the flips.
struct ChangeStatistic {
  std::string name;                 ///< "blocks of 4", "all pixels of blocks of 1"
  double observed = 0;              ///< largest |t| of any block and channel; or the sum of log(1 + t^2 / (K - 1))
  double expected = 0, spread = 0;  ///< mean and standard deviation over flips of what the differences are beside their mean: of noise alone
  double excess = 0;                ///< (observed - expected) / spread
  int x = 0, y = 0, size = 0;       ///< where: pixels; size 0: everywhere
  std::string channel;              ///< "luminance", "red - green", "blue - green"; empty: all
};

struct ChangeFigures {
  bool sameBits = false;
  bool changed = false;
  double excess = 0;   ///< of the strongest statistic
  double chance = 1;   ///< Gumbel's tail at it, times the number of statistics: of another seed going as far. At most 1
  int strongest = -1;  ///< index in `statistics`; -1: none
  std::vector<ChangeStatistic> statistics;
  double meanReference = 0, meanNow = 0;  ///< (R + G + B) / 3 over all pixels
  double meanStandardError = 0;           ///< of their difference, from the parts; 0 with one part
  double noiseRmse = 0;                   ///< RMSE between the two means that the scatter of their differences explains; 0 with one part
  std::vector<float> map;                 ///< a value a pixel: largest excess of a block around it, at least 0. Empty where bits are the same
};

/// Errors: InvalidArgument: sizes or numbers of parts that differ, fewer parts than kFewestParts but not one, a value that is not finite (which part and
/// pixel). O(128 * parts * pixels).
Result<ChangeFigures> findChange(const std::vector<Image>& reference, const std::vector<Image>& now, const ChangeOptions& options = {});

/// Bit k of each: part k has its other sign. Part 0 never has; with "none has" they are a group of 128 (of fewer parts than 8: of all there are), in which no
/// two parts go together or against each other throughout.
std::vector<uint32_t> signFlips(int parts);

/// The mean of parts of one size (CHECKed).
Image meanOf(const std::vector<Image>& parts);

}  // namespace measure
}  // namespace gobo

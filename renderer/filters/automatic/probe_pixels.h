// SPDX-License-Identifier: Apache-2.0
// Which pixels of a picture a probe looks at closely, when the error that it looks for is near edges of shadows and these are rare: two-phase sampling with
// stratification (Neyman 1938), on a tree. A first look at one random pixel of each cell of a grid; cells that see something else than a neighbour does hold an
// edge, some of them are cut into four, each with a look of its own, and so on. Pixels to judge are drawn half from the last level's cells with an edge and
// half from all that looked even on the way. Every step draws with known probability, so
//     sum over judged pixels of weight * f(pixel)     has the mean of f over the picture as its expectation
// for any f, whether the looks tell much about it or not; an f that lies at edges has a far smaller variance than by even sampling.
// Cost: cells + 4 * split * levels looks, `judged` pixels. Deterministic in the seed. Fails to help (but stays right) where edges are everywhere or looks see
// none.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "base/status.h"

namespace gobo {
inline namespace filters {

struct PixelPlace {
  int x = 0, y = 0;
};
/// What a look says of a pixel.
enum class ProbeSeen : uint8_t { Nothing, Dark, Lit, Both };

struct ProbeDesign {
  int width = 0, height = 0;
  int cells = 576;   ///< of the first look, about; fewer in pictures of fewer than 4 pixels a cell
  int split = 64;    ///< cells that are cut into four, per level, at most
  int levels = 1;    ///< cells narrower than 4 pixels are not cut
  int judged = 128;  ///< pixels in all; at least 2 in each stratum
  uint64_t seed = 0;
};

struct ProbePixel {
  PixelPlace at;
  uint32_t stratum = 0;  ///< pixels of one stratum are consecutive
  double weight = 0;
};
struct ProbePixels {
  std::vector<ProbePixel> judged;  ///< as many as the design says
  double receivers = 0;            ///< share of pixels whose look saw more than Nothing
  double edges = 0;                ///< share of the picture in cells of the first look with an edge
};

/// `look` fills what each pixel shows; false: it was stopped (the answer is Cancelled).
using ProbeLook = std::function<bool(std::span<const PixelPlace> pixels, std::span<ProbeSeen> seen)>;
Result<ProbePixels> chooseProbePixels(const ProbeDesign& design, const ProbeLook& look);

/// Sum over judged pixels of weight * value, and the variance of that sum as its strata show it.
class StratifiedSum {
 public:
  /// Pixels in their order.
  void add(const ProbePixel& pixel, double value);
  double sum() const { return sum_ + part_; }
  double variance() const { return variance_ + partVariance(); }

 private:
  double partVariance() const;
  double sum_ = 0, variance_ = 0;                         // of finished strata
  double part_ = 0, mean_ = 0, squares_ = 0, count_ = 0;  // of the current one: Welford's sums
  uint32_t stratum_ = 0;
};

}  // namespace filters
}  // namespace gobo

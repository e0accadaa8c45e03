// SPDX-License-Identifier: Apache-2.0
// What to choose from candidates whose errors are known to within their standard errors, and whether a closer look could pay for itself.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace gobo {
inline namespace filters {

/// Predicted time of a candidate and what probes said of its error so far.
struct ProbeEvidence {
  double ms = 0;
  double mse = 0, variance = 0;  ///< mean squared error of visibility; variance of that estimate
  double pixels = 0;             ///< that it rests on; 0: not judged
  /// Another probe's estimate, which saw other pixels.
  void add(double otherMse, double otherVariance, double otherPixels);
  bool judged() const { return pixels > 0; }
  double high() const;  ///< RMSE a standard error (of the mean square) above the estimate: few pixels hold most of the error, and a probe sees few of them.
                        ///< Where it saw none: as if the next pixel lay on an edge
  double low() const;   ///< the same below
};

/// Evidence of more and more rays, whose errors fall: neighbours that are found to rise are one (isotonic regression; Ayer et al. 1955). Few pixels hold most
/// of an error, and one sequence of rays that misses it, or meets it, is no news of how many rays are enough.
std::vector<ProbeEvidence> fallingErrors(std::span<const ProbeEvidence> rays);

struct ShadowBudget {
  double error = 0;   ///< RMSE of visibility
  double timeMs = 0;  ///< 0: as little as the error allows; else the least error within it
};

/// Within an error: the cheapest that keeps it surely (high()); if none does, the cheapest of those that miss it by about as little as the best does. Within a
/// time: the least error of those that fit, else the cheapest. Those that were not judged are not chosen; at least one must be judged.
size_t chooseByEvidence(std::span<const ProbeEvidence> candidates, const ShadowBudget& budget);
/// Cheaper ones (within a time: any that fits) that would be chosen in the place of `chosen` if their errors were at the lower end of what is known.
std::vector<size_t> rivalsOf(std::span<const ProbeEvidence> candidates, const ShadowBudget& budget, size_t chosen);
/// Nothing was seen of its error, and one pixel on an edge among as many would make half of what is allowed.
bool blindChoice(std::span<const ProbeEvidence> candidates, const ShadowBudget& budget, size_t chosen);
/// Whether to look again at `chosen` and its rivals for `costMs`: what one of them would save, times the chance that it is found to do, must be more; or it
/// costs next to nothing beside what may be saved, or little beside a blind choice. Within a time, what is looked at must stay a small part of it.
bool worthAnotherLook(std::span<const ProbeEvidence> candidates, const ShadowBudget& budget, size_t chosen, std::span<const size_t> rivals, double costMs);

}  // namespace filters
}  // namespace gobo
